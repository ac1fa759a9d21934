"""What OpenCV makes of the images in this folder: prints opencv.json. Needs opencv-python-headless 5.0.0.93 or near."""

import json
import pathlib

import cv2
import numpy as np

HERE = pathlib.Path(__file__).parent
SQUARE_MM = 25.0
board = np.zeros((54, 3), np.float32)
board[:, :2] = np.mgrid[0:9, 0:6].T.reshape(-1, 2) * SQUARE_MM
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)


def calibrate(camera, half):
    names, corners = [], []
    for path in sorted((HERE / camera).glob("*.jpg")):
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        found, rough = cv2.findChessboardCorners(image, (9, 6), None)
        assert found, path
        corners.append(cv2.cornerSubPix(image, rough, (half, half), (-1, -1), STOP))
        names.append(path.name)
    boards = [board] * len(corners)
    rms, matrix, lens, _, _, sigma, _, per_image = cv2.calibrateCameraExtended(boards, corners, (640, 480), None, None)
    sigma = sigma.ravel()
    return corners, matrix, lens, {
        "focal_px": [matrix[0, 0], matrix[1, 1]],
        "focal_sigma_px": sigma[0:2].tolist(),
        "principal_px": [matrix[0, 2], matrix[1, 2]],
        "principal_sigma_px": sigma[2:4].tolist(),
        "distortion": lens.ravel().tolist(),
        "distortion_sigma": sigma[4:9].tolist(),
        "rms_px": rms,
        "images": dict(zip(names, per_image.ravel().tolist())),
    }


results = {"opencv": cv2.__version__, "flags": 0, "square_mm": SQUARE_MM, "half_windows": {}}
for half in (5, 11):
    left, right = calibrate("left", half), calibrate("right", half)
    stereo = cv2.stereoCalibrate(
        [board] * len(left[0]), left[0], right[0], left[1], left[2], right[1], right[2], (640, 480),
        flags=cv2.CALIB_FIX_INTRINSIC, criteria=(STOP[0], 200, 1e-10),
    )
    results["half_windows"][str(half)] = {
        "left": left[3],
        "right": right[3],
        "rig": {
            "baseline_mm": float(np.linalg.norm(stereo[6])),
            "rotation_deg": np.degrees(cv2.Rodrigues(stereo[5])[0]).ravel().tolist(),
            "rms_px": stereo[0],
        },
    }
print(json.dumps(results, indent=1))
