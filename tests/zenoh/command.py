"""Moves a simulated station by topics of ROS 2, and reads the stage's position off its pins.

    command.py TRINOCULAR FOLDER
"""

import atexit
import os
import pathlib
import queue
import re
import subprocess
import sys
import threading
import time

import numpy as np
import zenoh
from rosbags.typesys import Stores, get_typestore

from router import configuration, free_endpoint

DOMAIN = 9
STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = {"stop": "std_msgs/msg/Empty", "reset": "std_msgs/msg/Empty",
         "follow": "std_msgs/msg/Bool", "goal": "geometry_msgs/msg/PointStamped"}
#: Longest wait, s: a busy computer is slow.
PATIENCE_S = 120


class Program:
    """A run of the program, and the lines that it prints."""

    def __init__(self, *command):
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            text=True, env=os.environ | {"ROS_DOMAIN_ID": str(DOMAIN)})
        self.lines, self.printed = queue.Queue(), []
        threading.Thread(target=self._read, daemon=True).start()
        # Nothing is left after a failure.
        atexit.register(self.process.kill)

    def _read(self):
        for line in self.process.stdout:
            self.lines.put(line)

    def wait_for(self, pattern):
        """Waits for a line; returns its match."""
        end = time.monotonic() + PATIENCE_S
        while True:
            try:
                line = self.lines.get(timeout=max(end - time.monotonic(), 0.01))
            except queue.Empty:
                raise AssertionError(f"no {pattern!r} in {self.printed}") from None
            self.printed.append(line)
            if match := re.search(pattern, line):
                return match

    def ask(self, line):
        """Sends a line to standard input."""
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def end(self):
        """Ends the run as Ctrl-C does."""
        self.process.send_signal(2)
        assert self.process.wait(PATIENCE_S) == 0, self.printed


def message(kind, *values):
    """Returns a message of a type of ROS 2, serialised."""
    return bytes(STORE.serialize_cdr(STORE.types[kind](*values), kind))


EMPTY = message("std_msgs/msg/Empty")


def switch(on):
    """Returns a Bool."""
    return message("std_msgs/msg/Bool", on)


def goal(millimetres, frame="stage", age_s=0.0):
    """Returns a PointStamped whose stamp is some seconds old."""
    now = time.time() - age_s
    types = STORE.types
    stamp = types["builtin_interfaces/msg/Time"](int(now), int(now % 1 * 1e9))
    header = types["std_msgs/msg/Header"](stamp, frame)
    point = types["geometry_msgs/msg/Point"](*(1e-3 * value for value in millimetres))
    return message("geometry_msgs/msg/PointStamped", header, point)


class Node:
    """The side of the nodes: a router, and a publisher per command."""

    def __init__(self, router):
        self.router = router
        self.tokens = []
        router.liveliness().declare_subscriber(
            "@ros2_lv/**", lambda sample: self.tokens.append(str(sample.key_expr)))

    def subscriptions(self):
        """Returns the topics that the program subscribes, by name."""
        found = {}
        for token in self.tokens:
            parts = token.split("/")
            if parts[5] == "MS":
                topic, kind, digest = parts[9:12]
                found[topic.split("%")[-1]] = topic.replace("%", "/"), kind, digest
        return found

    def send(self, name, payload, kind=None):
        """Publishes a command, of its own type or another, as rmw_zenoh_cpp does."""
        kind = kind or TYPES[name]
        package, short = kind.split("/msg/")
        digest = STORE.hash_rihs01(kind)
        key = f"{DOMAIN}/trinocular/{name}/{package}::msg::dds_::{short}_/{digest}"
        self.router.put(key, payload)


def check_subscriptions(node):
    """Waits for all subscriptions, and checks their types."""
    end = time.monotonic() + PATIENCE_S
    while len(node.subscriptions()) < len(TYPES) and time.monotonic() < end:
        time.sleep(0.01)
    found = node.subscriptions()
    assert found.keys() == TYPES.keys(), node.tokens
    for name, (topic, kind, digest) in found.items():
        package, short = TYPES[name].split("/msg/")
        assert topic == f"/trinocular/{name}"
        assert kind == f"{package}::msg::dds_::{short}_" and digest == STORE.hash_rihs01(TYPES[name])


def where(twin):
    """Returns the position of the stage by the edges at its pins, mm."""
    twin.ask("where")
    return np.array([float(value) for value in twin.wait_for(
        r"stage at (-?[\d.]+) (-?[\d.]+) (-?[\d.]+) mm").groups()])


def arrives(twin, millimetres):
    """Waits until the stage is at a place, within a step."""
    end = time.monotonic() + PATIENCE_S
    while np.abs(where(twin) - millimetres).max() > 0.0125:
        assert time.monotonic() < end, (where(twin), millimetres)
        time.sleep(0.05)


def rests(twin):
    """Waits until the stage stands; returns its position."""
    before = where(twin)
    while True:
        time.sleep(0.2)
        after = where(twin)
        if (after == before).all():
            return after
        before = after


def main(trinocular, folder):
    """Sends commands that are to be done, and others that are not."""
    link, endpoint = str(pathlib.Path(folder) / "station"), free_endpoint()
    with zenoh.open(configuration("router", endpoint)) as router:
        node = Node(router)
        rig = str(pathlib.Path(folder) / "rig.toml")
        subprocess.run([trinocular, "init", "--defaults", rig], check=True, capture_output=True)
        twin = Program(trinocular, "twin", "--link", link, "--rig", rig)
        twin.wait_for("simulated")
        serve = [trinocular, "serve", "--listen", "127.0.0.1:0", "--port", link,
                 f"--zenoh={endpoint}", "--heartbeat", "5000"]
        # Without --control there is no topic of commands.
        shown = Program(*serve)
        shown.wait_for("publishing in ROS domain 9")
        assert not node.subscriptions(), node.tokens
        shown.end()

        served = Program(*serve, "--control", "--rig", rig)
        served.wait_for("every node that reaches .* can move the stage")
        check_subscriptions(node)
        node.send("goal", goal((3, -2, 1)))
        arrives(twin, (3, -2, 1))
        # An absolute place: the same goal again moves nothing.
        node.send("goal", goal((3, -2, 1)))
        node.send("goal", goal((0, 0, 0.5)))
        arrives(twin, (0, 0, 0.5))

        rest = rests(twin)
        refusals = [
            (goal((1, 1, 1), frame="map"), 'goal was not done: its frame_id is "map"'),
            (goal((1, 1, 1), age_s=60), r"goal was not done: its stamp is 6\d\.\d s old"),
            (goal((1, 5000, 1)), "its y is 5"),
            (goal((1, float("nan"), 1)), "its y is NaN"),
            (goal((1, 1, 70)), "z = 70 mm is outside the soft limits"),
            (goal((1, 1, 1))[:40], "it ends within a field"),
            (b"", "it ends within a field"),
        ]
        for payload, words in refusals:
            node.send("goal", payload)
            served.wait_for(words)
        assert (rests(twin) == rest).all()

        # A stop ends a long way early, and is the last word until a reset. Its content and its type
        # do not matter.
        for payload, kind in ((b"anything", None), (switch(True), "std_msgs/msg/Bool")):
            node.send("goal", goal((50, 0, 0.5)))
            while where(twin)[0] < 2:
                pass
            node.send("stop", payload, kind)
            stopped = rests(twin)
            assert 2 < stopped[0] < 49, stopped
            node.send("goal", goal((0, 0, 0.5)))
            served.wait_for("goal was not done: .*stopped")
            assert (rests(twin) == stopped).all()
            node.send("reset", EMPTY)
            # Nothing says that the reset was done; until then goals are refused.
            end = time.monotonic() + PATIENCE_S
            while np.abs(where(twin)).max() > 0.6 and time.monotonic() < end:
                node.send("goal", goal((0, 0, 0.5)))
                time.sleep(0.5)
            arrives(twin, (0, 0, 0.5))

        # While it follows, goals are refused; rendered cameras see a target that moves.
        node.send("follow", switch(True))
        while np.abs(where(twin) - (0, 0, 0.5)).max() < 0.1:
            pass
        node.send("goal", goal((0, 0, 0)))
        served.wait_for("goal was not done: end following first")
        node.send("follow", switch(False))
        rests(twin)
        served.end()
        twin.ask("quit")
        assert twin.process.wait(PATIENCE_S) == 0
    print(f"zenoh: goals, stop, reset and follow done; {len(refusals) + 2} commands refused by name")


main(*sys.argv[1:])
