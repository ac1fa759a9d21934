"""A Zenoh router on a free port of this computer, as a node of ROS 2 would meet it."""

import socket

import zenoh


def configuration(mode, listen):
    """Returns the configuration of a session that finds nothing by itself."""
    config = zenoh.Config()
    config.insert_json5("mode", f'"{mode}"')
    config.insert_json5("listen/endpoints", f'["{listen}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    return config


def free_endpoint():
    """Returns an endpoint on this computer that nothing listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"
