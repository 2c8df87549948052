"""Topics and services, as the node's own code makes them: it is handed a node that only notes."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from types import ModuleType
from typing import Any
from unittest.mock import patch

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile

from rsmb_ros.core.config import Config
from rsmb_ros.messages.outputs import Output
from rsmb_ros.ros import outputs as node_outputs
from rsmb_ros.ros.subscriptions import Subscriptions, Topics

from .sources import calls
from .tables import code, described, table

INPUTS = {
    'image': 'live frames; the newest wins, older ones are dropped and counted',
    'reference/image': 'clean reference, latched or volatile; may be replaced at any time; may be '
    'larger or smaller than the frames',
    'reference/depth': 'optional: depth of the reference, 32FC1 [m] or 16UC1 [mm], with its stamp '
    'and size; divided by its median, so relative depth will do; NaN and 0 are unknown',
    'camera_info': 'optional: focal length `k[0]`, divided by the binning',
}
OUTPUTS = {
    'registered': 'uint8, the reference as the live camera would have seen it: warped row by row, '
    'blurred, same light; 0 outside the reference',
    'rectified': 'uint8, the live frame in the geometry of the reference; 0 where it does not '
    'reach',
    'change_mask': 'mono8 on the live grid: 255 changed, 0 not',
    'valid_mask': 'mono8 on the live grid: 255 judged, 0 unknown',
    'residual': '32FC1, live - registered [grey levels], 0 where unknown',
    'overlay': 'bgr8, for people: changes red with score, static objects green with relative '
    'depth, unknown hatched',
    'row_motion': 'rows x (t_x px, t_y px, r_z deg, scale, r_x deg, r_y deg): the centroid pose of '
    'each row; NaN when not registered',
    'regions_json': 'status, reason, exposure, gain, regions and timings; the fields of '
    '[result.json](files.md#resultjson) without `row_motion`, `config` and `version`, with `stamp` '
    'and `frame_id`',
    'regions': 'the changes, `class_id` `change`, with score and id; only where vision_msgs is '
    'installed',
}
SERVICES = {
    '~/enable': 'false: frames are dropped and nothing is published until true',
    '~/set_reference': 'the next live frame becomes the reference; it is not answered itself',
}
LIFECYCLE = (
    ('~/change_state', 'lifecycle_msgs/ChangeState'),
    ('~/get_state', 'lifecycle_msgs/GetState'),
    ('~/get_available_states', 'lifecycle_msgs/GetAvailableStates'),
    ('~/get_available_transitions', 'lifecycle_msgs/GetAvailableTransitions'),
    ('~/get_transition_graph', 'lifecycle_msgs/GetAvailableTransitions'),
)


@dataclass(frozen=True)
class Endpoint:
    """One topic as it was asked for."""

    topic: str
    type: str  # ROS type
    qos: QoSProfile


class _Noting:
    """Stands in for the node: notes the endpoints and makes none."""

    def __init__(self) -> None:
        self.made: list[Endpoint] = []

    @staticmethod
    def resolve_topic_name(name: str) -> str:
        return name

    def create_subscription(
        self, kind: type, topic: str, callback: Any, qos: QoSProfile, **others: Any
    ) -> None:
        self.made.append(Endpoint(topic, _ros_type(kind), qos))

    def create_publisher(self, kind: type, topic: str, qos: QoSProfile, **others: Any) -> None:
        self.made.append(Endpoint(topic, _ros_type(kind), qos))


class _NoReception:
    """Stands in for the callbacks."""

    def __getattr__(self, name: str) -> None:
        return None


def inputs(compressed: bool) -> list[Endpoint]:
    """Return what an active node subscribes to."""
    node: Any = _Noting()
    Subscriptions(node, Topics.of(node, compressed), compressed, _NoReception())  # type: ignore
    return node.made


def outputs() -> list[Endpoint]:
    """Return what a configured node publishes, with what it publishes where vision_msgs is."""
    node: Any = _Noting()
    node_outputs.Outputs(node, Config().publish.queue_depth)
    made = {endpoint.topic: endpoint for endpoint in node.made}
    some_qos = node.made[0].qos
    for output in _detections():
        topic, kind = f'~/{output.name}', output.type.replace('/msg/', '/')
        made.setdefault(topic, Endpoint(topic, kind, some_qos))
    return list(made.values())


def services() -> dict[str, str]:
    """Return name -> type of the node's own services."""
    return {name: f'std_srvs/{kind}' for kind, name, *_ in calls('ros/node.py', 'create_service')}


def input_table() -> str:
    """Return the topics that are read; a topic with two readers has both QoS."""
    found: dict[str, list[Endpoint]] = {}
    for endpoint in inputs(compressed=False):
        found.setdefault(endpoint.topic, []).append(endpoint)
    texts = described(found, INPUTS, __file__)
    rows = [
        (code(name), ends[0].type, '; and '.join(_qos(end.qos) for end in ends), texts[name])
        for name, ends in sorted(found.items(), key=lambda one: list(INPUTS).index(one[0]))
    ]
    return table(('topic', 'type', 'QoS', 'content'), rows)


def compressed_names() -> str:
    """Return which names change with `image_transport: compressed`."""
    raw, compressed = inputs(compressed=False), inputs(compressed=True)
    pairs = {
        f'{code(old.topic)} becomes {code(new.topic)} ({new.type})': None
        for old, new in zip(raw, compressed, strict=True)
        if old.topic != new.topic
    }
    return ', '.join(pairs)


def output_table() -> str:
    """Return the topics that are published."""
    made = outputs()
    texts = described([end.topic.removeprefix('~/') for end in made], OUTPUTS, __file__)
    rows = [
        (code(end.topic), end.type, texts[end.topic.removeprefix('~/')])
        for end in sorted(made, key=lambda one: list(OUTPUTS).index(one.topic[2:]))
    ]
    (diagnostics,) = ((topic, kind) for _, kind, topic, *_ in calls('ros/node.py', 'publisher'))
    rows.append(
        (
            code(diagnostics[0]),
            f'diagnostic_msgs/{diagnostics[1]}',
            'once a second, in every state; see [Diagnostics](diagnostics.md)',
        )
    )
    return table(('topic', 'type', 'content'), rows)


def output_qos() -> str:
    """Return the QoS of the outputs in words."""
    (qos,) = {_qos(end.qos) for end in outputs()}
    return qos


def service_table() -> str:
    """Return the services."""
    own = services()
    texts = described(own, SERVICES, __file__)
    rows = [(code(name), kind, texts[name]) for name, kind in own.items()]
    rows += [(code(name), kind, 'of every managed node') for name, kind in LIFECYCLE]
    return table(('service', 'type', 'does'), rows)


def _detections() -> tuple[Output, ...]:
    """Return the outputs of a node that has vision_msgs, whether it is installed here or not."""
    stub = ModuleType('vision_msgs.msg')
    for name in ('Detection2D', 'Detection2DArray', 'ObjectHypothesisWithPose'):
        setattr(stub, name, type(name, (), {}))
    spec = importlib.util.find_spec('rsmb_ros.ros.detections')
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    with patch.dict(sys.modules, {'vision_msgs': stub, 'vision_msgs.msg': stub}):
        spec.loader.exec_module(module)
    return module.OUTPUTS


def _ros_type(kind: type) -> str:
    return f'{kind.__module__.split(".")[0]}/{kind.__name__}'


def _qos(qos: QoSProfile) -> str:
    assert qos.history in (HistoryPolicy.KEEP_LAST, HistoryPolicy.SYSTEM_DEFAULT)
    reliability = qos.reliability.name.lower().replace('_', ' ')
    latched = qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
    return f'{reliability}, {"transient local" if latched else "volatile"}, depth {qos.depth}'


def topic_names() -> Iterator[str]:
    """Yield every topic the page must name."""
    yield from (end.topic for end in inputs(compressed=False))
    yield from (end.topic for end in outputs())
