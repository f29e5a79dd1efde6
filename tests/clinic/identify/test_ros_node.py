"""The ROS 2 node of docs/live.md, with stand-ins for ROS, which is not installed here."""

import re
import sys
from contextlib import contextmanager
from types import ModuleType, SimpleNamespace
from typing import Any, ClassVar

import pytest

import nsaid_mj
from tests.support.faulty import CHECKOUT

PAGE = (CHECKOUT / "docs" / "live.md").read_text(encoding="utf-8")
(SOURCE,) = re.findall(r"test_ros_node\.py -->\n```python\n(.*?)```", PAGE, re.DOTALL)


class Node:
    """As much of rclpy.node.Node as the node uses."""

    warnings: ClassVar[list[str]] = []

    def __init__(self, name):
        assert name

    def create_subscription(self, kind, topic, callback, depth):
        self.topic, self.callback = topic, callback

    def get_logger(self):
        return SimpleNamespace(warn=lambda text, **_: self.warnings.append(text))


def message(k):
    """Joints in another order than the model's."""
    stamp = SimpleNamespace(sec=1_700_000_000, nanosec=2_000_000 * k)
    return SimpleNamespace(
        name=["elbow", "shoulder"],
        position=[10.0 + k, 20.0 + k],
        velocity=[1.0, 2.0],
        effort=[3.0, 4.0],
        header=SimpleNamespace(stamp=stamp),
    )


@pytest.fixture
def taken(monkeypatch):
    """The samples that the node hands over while it spins along three messages."""
    samples, misfits = [], iter([None, "none", "contradicts"])

    class Identifier:
        def update(self, *sample):
            samples.append(sample)
            misfit = next(misfits)
            return None if misfit is None else SimpleNamespace(misfit=misfit)

    @contextmanager
    def live(model, rate):
        assert (model, rate) == ("arm.urdf", 500)
        yield Identifier()

    def spin(node):
        assert node.topic == "joint_states"
        for k in range(3):
            node.callback(message(k))

    rclpy, ros_node = ModuleType("rclpy"), ModuleType("rclpy.node")
    sensor_msgs, msg = ModuleType("sensor_msgs"), ModuleType("sensor_msgs.msg")
    rclpy.init, rclpy.spin, ros_node.Node, msg.JointState = lambda: None, spin, Node, object
    for module in (rclpy, ros_node, sensor_msgs, msg):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr(nsaid_mj, "live", live, raising=False)
    Node.warnings.clear()
    space: dict[str, Any] = {"__name__": "node"}
    exec(compile(SOURCE, "docs/live.md", "exec"), space)
    space["main"]("arm.urdf", "shoulder", "elbow")
    return samples


def test_samples_are_in_the_models_order_and_in_seconds(taken):
    assert [sample[1:] for sample in taken] == [
        ([20.0 + k, 10.0 + k], [2.0, 1.0], [4.0, 3.0]) for k in range(3)
    ]
    assert [sample[0] - taken[0][0] for sample in taken] == pytest.approx(
        [0, 0.002, 0.004], abs=1e-6
    )


def test_a_misfit_is_told_and_nothing_else(taken):
    assert taken and Node.warnings == ["the motion contradicts the model"]
