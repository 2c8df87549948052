"""Truth objects are found, missed or not there."""

import pytest

from rsmb_ros.evaluation.matching import (
    FOUND_IOU,
    TOUCH_PX,
    FrameScore,
    Tally,
    dilated,
    intersection,
    iou,
    score_frame,
)

CAR = (100, 50, 40, 20)
VAN = (10, 10, 30, 30)


def test_equal_boxes_have_iou_1_and_apart_ones_0():
    assert iou(CAR, CAR) == 1.0
    assert iou(CAR, VAN) == 0.0


def test_iou_counts_pixels():
    assert intersection((0, 0, 4, 4), (2, 1, 4, 2)) == 2 * 2
    assert iou((0, 0, 4, 4), (2, 1, 4, 2)) == pytest.approx(4 / (16 + 8 - 4))


def test_neighbouring_boxes_share_nothing():
    assert intersection((0, 0, 4, 4), (4, 0, 4, 4)) == 0
    assert intersection((0, 0, 4, 4), (3, 3, 4, 4)) == 1


def test_dilation_grows_all_four_sides():
    assert dilated((10, 20, 3, 4), 5) == (5, 15, 13, 14)


def test_object_is_found_from_a_quarter_of_overlap_on():
    x, y, width, height = CAR
    quarter = (x, y, width // 4, height)
    less = (x, y, width // 4 - 1, height)
    assert iou(quarter, CAR) == FOUND_IOU
    assert score_frame([quarter], {'car': CAR}).found == ('car',)
    assert score_frame([less], {'car': CAR}).missed == ('car',)


def test_each_object_is_judged_for_itself():
    score = score_frame([CAR], {'van': VAN, 'car': CAR})
    assert score == FrameScore(found=('car',), missed=('van',), false_alarms=())


def test_one_region_over_two_objects_finds_those_it_fits():
    near = (140, 50, 40, 20)
    both = (100, 50, 80, 20)
    assert score_frame([both], {'car': CAR, 'near': near}).found == ('car', 'near')


def test_region_at_a_missed_object_is_no_false_alarm():
    x, y, *_ = CAR
    beside = (x - 3 - TOUCH_PX, y, 4, 4)  # its last column is the first of the dilated box
    assert score_frame([beside], {'car': CAR}) == FrameScore((), ('car',), ())


def test_region_beyond_the_rim_of_every_object_is_a_false_alarm():
    x, y, *_ = CAR
    beyond = (x - 4 - TOUCH_PX, y, 4, 4)
    assert score_frame([beyond], {'car': CAR, 'van': VAN}).false_alarms == (beyond,)


def test_without_objects_every_region_is_a_false_alarm():
    assert score_frame([CAR, VAN], {}) == FrameScore((), (), (CAR, VAN))


def test_tally_adds_frames_up():
    tally = Tally()
    for regions, objects in (([], {}), ([CAR], {'car': CAR}), ([VAN], {'car': CAR})):
        tally.add(score_frame(regions, objects))
    assert tally == Tally(frames=3, present={'car': 2}, found={'car': 1}, false_alarms=1)
