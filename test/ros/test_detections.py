"""
Changes as Detection2DArray of vision_msgs 4.1 (Jazzy), which has no wheel.

A stand-in of its messages is made from their definition: it refuses fields that do not exist, and
what is built must serialise as the definition says.
"""

import importlib
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from rsmb_ros.core.types import Region

DEFINITIONS = {
    'Point2D': 'float64 x\nfloat64 y',
    'Pose2D': 'vision_msgs/Point2D position\nfloat64 theta',
    'BoundingBox2D': 'vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y',
    'ObjectHypothesis': 'string class_id\nfloat64 score',
    'ObjectHypothesisWithPose': 'vision_msgs/ObjectHypothesis hypothesis\n'
    'geometry_msgs/PoseWithCovariance pose',
    'Detection2D': 'std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n'
    'vision_msgs/BoundingBox2D bbox\nstring id',
    'Detection2DArray': 'std_msgs/Header header\nvision_msgs/Detection2D[] detections',
}
CHANGE = Region(x=10, y=20, width=5, height=4, area=17, kind='change', score=0.75, id=3)
STATIC = Region(x=1, y=2, width=3, height=4, area=9, kind='static', score=1.0)


@pytest.fixture(scope='module')
def store():
    """Return a type store that knows vision_msgs."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in DEFINITIONS.items():
        store.register(get_types_from_msg(text, f'vision_msgs/msg/{name}'))
    return store


def default(store, name):
    """Return a message with the defaults that rclpy's would have."""
    fields = {}
    for field, (kind, detail) in store.fielddefs[name][1]:
        kind = int(kind)
        if kind == 1:  # one number or string
            fields[field] = {'string': '', 'float64': 0.0}.get(detail[0], 0)
        elif kind == 2:  # a message
            fields[field] = default(store, detail)
        elif kind == 3:  # an array of numbers
            (_, (element, _)), length = detail
            fields[field] = np.zeros(length, element)
        else:  # a sequence
            fields[field] = []
    return store.types[name](**fields)


@pytest.fixture
def detections(store, monkeypatch):
    """Return the module under test, imported where vision_msgs is."""

    def stand_in(name):
        full = f'vision_msgs/msg/{name}'

        def make(**given):
            msg = default(store, full)
            for field, value in given.items():
                assert hasattr(msg, field), f'{full} has no field {field}'
                setattr(msg, field, value)
            return msg

        return make

    package, msg = ModuleType('vision_msgs'), ModuleType('vision_msgs.msg')
    for name in DEFINITIONS:
        setattr(msg, name, stand_in(name))
    monkeypatch.setitem(sys.modules, 'vision_msgs', package)
    monkeypatch.setitem(sys.modules, 'vision_msgs.msg', msg)
    monkeypatch.delitem(sys.modules, 'rsmb_ros.ros.detections', raising=False)
    yield importlib.import_module('rsmb_ros.ros.detections')
    # the next one to import it finds what is really installed
    sys.modules.pop('rsmb_ros.ros.detections', None)


def test_changes_are_detections_and_what_is_static_is_none(detections, store):
    (output,) = detections.OUTPUTS
    assert (output.name, output.type) == ('regions', 'vision_msgs/msg/Detection2DArray')
    header = default(store, 'std_msgs/msg/Header')
    header.frame_id = 'cam'
    header.stamp.sec = 7
    result = SimpleNamespace(regions=(STATIC, CHANGE), changes=(CHANGE,))
    built = output.build(result, None, None, header)
    sent = store.serialize_cdr(built, output.type)  # refuses wrong types
    msg = store.deserialize_cdr(sent, output.type)
    (found,) = msg.detections
    for place in (msg, found):
        assert (place.header.frame_id, place.header.stamp.sec) == ('cam', 7)
    assert found.id == '3'
    (what,) = found.results
    assert (what.hypothesis.class_id, what.hypothesis.score) == ('change', 0.75)
    box = found.bbox
    # columns 10 to 14, rows 20 to 23
    assert (box.center.position.x, box.center.position.y) == (12.0, 21.5)
    assert (box.size_x, box.size_y, box.center.theta) == (5.0, 4.0, 0.0)


def test_change_without_an_id_has_none(detections, store):
    header = default(store, 'std_msgs/msg/Header')
    region = Region(x=0, y=0, width=1, height=1, area=1, kind='change', score=1.0)
    msg = detections.detections(
        SimpleNamespace(regions=(region,), changes=(region,)), None, None, header
    )
    assert msg.detections[0].id == ''


def test_without_the_package_there_is_no_such_output(monkeypatch):
    monkeypatch.setitem(sys.modules, 'vision_msgs', None)  # import fails
    monkeypatch.delitem(sys.modules, 'rsmb_ros.ros.detections', raising=False)
    module = importlib.import_module('rsmb_ros.ros.detections')
    assert module.OUTPUTS == ()
    assert module.CLASSES == {}
