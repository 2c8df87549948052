"""Which of two explanations of a frame is taken, and when a path is not fitted again."""

from __future__ import annotations

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


def test_nothing_is_fitted_again_where_nothing_has_changed(refits, texture_of):
    ground = texture_of(240, 320, 6)
    result = Detector(ground, config=Config()).detect(np.roll(ground, 4, axis=1))
    assert not result.regions
    assert not refits
