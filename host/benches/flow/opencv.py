#!/usr/bin/env python3
"""OpenCV's frame set, timed on request.

usage: opencv.py DIR DISPARITY_LEFT DISPARITY_RIGHT FLOW_X FLOW_Y CORNERS

DIR holds left/ middle/ right/ with 000000.png and 000001.png. Each line on standard input is a number of repetitions; the answer is a
line of JSON: the median and the least time in milliseconds. An empty line asks for the accuracy.
"""

import json
import sys
import time

import cv2
import numpy as np

CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 0.01)
WINDOW, LEVEL = 21, 3


def follow(before, now, points):
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        before, now, points, None, winSize=(WINDOW, WINDOW), maxLevel=LEVEL, criteria=CRITERIA
    )
    return found, status.ravel() == 1


def smooth(image):
    return cv2.GaussianBlur(image, (5, 5), 0)


def frame_set(before, raw, corners):
    """The filtered images before are kept from the frame set before; those of now are new."""
    now = [smooth(image) for image in raw]
    points = cv2.goodFeaturesToTrack(before[1], corners, 0.01, 7)
    left, ok_left = follow(before[1], before[0], points)
    right, ok_right = follow(before[1], before[2], points)
    places = [left, points, right]
    found = [follow(before[k], now[k], places[k]) for k in range(3)]
    ok = ok_left & ok_right & found[0][1] & found[1][1] & found[2][1]
    return places, [f[0] for f in found], ok


def well_inside(points, image):
    """The window around it is within the image."""
    points, margin = points.reshape(-1, 2), (WINDOW + 1) // 2
    return ((points > margin) & (points < np.array(image.shape[::-1]) - margin)).all(axis=1)


def accuracy(found, truth, inside):
    distance = np.linalg.norm(found.reshape(-1, 2) - np.array(truth), axis=1)
    wrong = ~(distance < 1)
    right = ~wrong & inside
    rms = float(np.sqrt((distance[right] ** 2).mean())) if right.any() else None
    return {"wrong": int(wrong.sum()), "right": int(right.sum()), "rms_px": rms}


def main():
    folder, numbers, corners = sys.argv[1], [float(a) for a in sys.argv[2:6]], int(sys.argv[6])
    cv2.setNumThreads(1)
    read = lambda frame: [
        cv2.imread(f"{folder}/{camera}/{frame:06}.png", cv2.IMREAD_GRAYSCALE)
        for camera in ("left", "middle", "right")
    ]
    before, raw = [smooth(image) for image in read(0)], read(1)
    print(json.dumps({"version": cv2.__version__}), flush=True)
    for line in sys.stdin:
        if line.strip():
            times = []
            for _ in range(int(line)):
                start = time.perf_counter_ns()
                frame_set(before, raw, corners)
                times.append((time.perf_counter_ns() - start) / 1e6)
            print(json.dumps({"times_ms": times}), flush=True)
        else:
            places, found, ok = frame_set(before, raw, corners)
            trusted = lambda points: points.reshape(-1, 2)[ok]
            flows = np.vstack([trusted(found[k]) - trusted(places[k]) for k in range(3)])
            middle = trusted(places[1])
            spatial = np.vstack(
                [trusted(places[0]) - middle - (numbers[0], 0), trusted(places[2]) - middle - (numbers[1], 0)]
            )
            inside = np.logical_and.reduce([well_inside(trusted(p), raw[0]) for p in places + found])
            answer = {
                "points": int(inside.sum()),
                "temporal": accuracy(flows, numbers[2:], np.tile(inside, 3)),
                "spatial": accuracy(spatial, (0, 0), np.tile(inside, 2)),
            }
            print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
