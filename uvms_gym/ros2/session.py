"""Start and end of a node, its name, and its logs."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from uvms_gym._extras import extra

with extra("ros2-node"):
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from rclpy.signals import SignalHandlerOptions

#: Time for other nodes to be discovered, s.
DISCOVERY = 2.0
#: Sent again to nodes that come later.
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Session:
    """Node with an executor of its own.

    `owned` are topics that no other node may publish.
    """

    def __init__(self, node: Any, owned: Sequence[str], context: Any) -> None:
        self.node, self._context = node, context
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(node)
        self._said: set[str] = set()
        self._owned = owned

    def refuse_taken(self) -> None:
        """Raise a ValueError where another node has the name or publishes an owned topic."""
        own = (self.node.get_name(), self.node.get_namespace())
        end = time.monotonic() + DISCOVERY
        while time.monotonic() < end:
            if self.node.get_node_names_and_namespaces().count(own) > 1:
                name = self.node.get_fully_qualified_name()
                raise ValueError(f"{name} is the name of another node: end it, or give another --namespace")
            for topic in self._owned:
                if self.publishers(topic):
                    name = self.node.resolve_topic_name(topic)
                    raise ValueError(f"{name} is published by another node: end it, or give --namespace or --remap")
            self.spin(0.05)

    def publishers(self, topic: str) -> int:
        """Number of publishers of a topic, under its name after --remap, which rclpy does not apply here."""
        return int(self.node.count_publishers(self.node.resolve_topic_name(topic)))

    def subscribers(self, topic: str) -> int:
        """Number of subscribers of a topic, as of `publishers`."""
        return int(self.node.count_subscribers(self.node.resolve_topic_name(topic)))

    def spin(self, seconds: float) -> None:
        """Handle what comes until the first message or the end of a time, s."""
        self._executor.spin_once(timeout_sec=max(0.0, seconds))

    def spin_until(self, done: Callable[[], bool], seconds: float) -> bool:
        """Handle messages until something is true; False after so many seconds, s."""
        end = time.monotonic() + seconds
        while not done():
            if (left := end - time.monotonic()) <= 0.0:
                return False
            self.spin(min(left, 0.1))
        return True

    def say(self, text: str, *, once: bool = True) -> None:
        """Log a line; by default the same line once."""
        if not once or text not in self._said:
            self._said.add(text)
            self.node.get_logger().info(text)

    def forget(self, text: str) -> None:
        """Let a line be logged again."""
        self._said.discard(text)


@contextmanager
def session(
    name: str, namespace: str = "/", remaps: Sequence[str] = (), owned: Sequence[str] = ()
) -> Iterator[Session]:
    """Node for the duration of a block, in a context of its own.

    `remaps` are `FROM:=TO`.

    Raises
    ------
    ValueError
        A name is malformed or taken.
    """
    for remap in remaps:
        if not re.fullmatch(r"[^\s:=]+:=[^\s:=]+", remap):
            raise ValueError(f"remap is {remap!r}, but must be FROM:=TO")
    arguments = ["--ros-args", *(part for remap in remaps for part in ("-r", remap))] if remaps else []
    context = rclpy.Context()
    try:
        rclpy.init(args=arguments, context=context, signal_handler_options=SignalHandlerOptions.NO)
        node = rclpy.create_node(name, namespace=namespace, context=context, enable_rosout=False)
    except Exception as error:  # Several unrelated classes of rclpy.
        if context.ok():
            context.shutdown()
        raise ValueError(f"the node {name} in {namespace} cannot start: {' '.join(str(error).split())}") from None
    try:
        made = Session(node, owned, context)
        made.refuse_taken()
        yield made
    finally:
        node.destroy_node()
        context.shutdown()
