"""Which of two explanations of a frame is taken, and when a path is not fitted again."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rsmb_ros.core import Config, Detector
from rsmb_ros.core.change_finder import Finding
from rsmb_ros.core.path_stage import PathStage

SHAPE = (40, 60)


def finding(unexplained, judged=None):
    """A finding whose candidates cover `unexplained` rows; `judged` rows lie in the reference."""
    mask = np.zeros(SHAPE, np.uint8)
    mask[:unexplained] = 1
    known = np.zeros(SHAPE, bool)
    known[-SHAPE[0] if judged is None else -judged :] = True
    frame = SimpleNamespace(judged=known, complete=known)
    return Finding(frame, SimpleNamespace(mask=mask), (), np.zeros(SHAPE[0], bool))


def test_the_explanation_that_leaves_less_is_better():
    assert finding(3).better_than(finding(9))
    assert not finding(9).better_than(finding(3))


def test_nothing_is_explained_by_leaving_the_reference():
    away = finding(9, judged=25)  # none of its candidates lies in the reference
    assert away.not_ground == 0.0 < finding(9).not_ground
    assert not away.better_than(finding(9))


@pytest.fixture
def refits(monkeypatch):
    """What each further fit was to leave out."""
    left_out = []
    refined = PathStage.refined

    def counted(stage, frame, foreground, still):
        left_out.append(foreground)
        return refined(stage, frame, foreground, still)

    monkeypatch.setattr(PathStage, 'refined', counted)
    return left_out


def test_a_path_that_nothing_new_is_left_out_of_is_not_fitted_again(refits, texture_of):
    ground = texture_of(240, 320, 6)
    live = np.roll(ground, 4, axis=1)
    live[80:126, 120:164] = 255 - live[80:126, 120:164]  # a fortieth of the frame
    result = Detector(ground, config=Config()).detect(live)
    assert len(result.changes) == 1
    assert len(refits) == 1  # without the object; then it stands


def test_a_frame_is_shown_anew_only_where_its_path_moves(texture_of):
    """Rows that lie outside the reference do not count, however far they move."""
    ground = texture_of(240, 320, 6)
    detector = Detector(ground, config=Config())
    frame = detector.detect(np.roll(ground, 4, axis=1)).views
    stage = detector._stages[240, 320][2]
    beside = np.zeros((240, 320), bool)
    assert stage.refined(frame, beside, 0.2) is frame
    assert stage.refined(frame, beside, 0.0) is not frame
    path = frame.path
    control = path.control.copy()
    control[:3] += 30.0  # the first rows'
    other = replace(path, control=control)
    assert frame.moved(other) > 10.0
    frame.complete[: int(3 * path.knot_rows)] = False
    assert frame.moved(other) < 0.2
    frame.complete[:] = False
    assert frame.moved(other) == 0.0


def test_other_ways_round_are_for_layers_only(texture_of):
    """Half of the width is new in many rows: what fits there may be the wrong plane."""
    ground = texture_of(240, 320, 6)
    live = np.roll(ground, 4, axis=1)
    live[60:180, 40:200] = 255 - live[60:180, 40:200]
    tried = {}
    for layers in (True, False):
        result = Detector(ground, config=Config().replaced({'layers.enabled': layers})).detect(live)
        assert len(result.changes) == 1
        tried[layers] = 'other way' in result.timings_ms
    assert tried == {True: True, False: False}


def test_nothing_is_fitted_again_where_nothing_has_changed(refits, texture_of):
    ground = texture_of(240, 320, 6)
    result = Detector(ground, config=Config()).detect(np.roll(ground, 4, axis=1))
    assert not result.regions
    assert not refits
