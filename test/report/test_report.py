"""Pictures and pages for people: what must be seen can be seen."""

from __future__ import annotations

import base64
import re

import cv2
import numpy as np
import pytest

from rsmb_ros.core.types import NOT_REGISTERED, REGISTERED, Region, Result
from rsmb_ros.report.html import Report, Table, evenly
from rsmb_ros.report.overlay import CHANGE, STATIC, describe, draw_overlay
from rsmb_ros.report.sheet import contact_sheet

SHAPE = (240, 320)


def result_with(regions=(), status=REGISTERED, reason='', unknown_left=0):
    """A result with square regions of the given boxes."""
    mask = np.zeros(SHAPE, np.uint8)
    for region in regions:
        if region.kind == 'change':
            mask[region.y : region.y + region.height, region.x : region.x + region.width] = 255
    valid = np.full(SHAPE, 255, np.uint8)
    valid[:, :unknown_left] = 0
    return Result(
        status=status,
        reason=reason,
        change_mask=mask,
        valid_mask=valid,
        residual=np.zeros(SHAPE, np.float32),
        row_motion=np.zeros((SHAPE[0], 6)),
        row_uncertainty=np.zeros(SHAPE[0]),
        regions=tuple(regions),
        exposure_rows=42.0,
        gain=1.0,
        timings_ms={},
        views=None,
    )


def box(kind, x, y, depth=None):
    return Region(x, y, 40, 30, 1200, kind, 0.9, depth)


@pytest.fixture
def live():
    return np.full(SHAPE, 128, np.uint8)


def test_changes_are_outlined_red_and_static_objects_boxed_green(live):
    picture = draw_overlay(live, result_with([box('change', 60, 80), box('static', 200, 80, 0.8)]))
    assert picture.shape == (*SHAPE, 3)
    assert (picture[95, 60] == CHANGE).all()
    assert (picture[95, 200] == STATIC).all()
    assert (picture[95, 80] == 128).all()  # the object itself stays to be seen
    assert (live == 128).all()  # the live image is not drawn into


def test_unknown_pixels_differ_from_judged_ones(live):
    picture = draw_overlay(live, result_with(unknown_left=50))
    assert (picture[:180, :50].reshape(-1, 3) != 128).any(axis=1).all()
    assert (picture[:180, 52:] == 128).all()


def test_status_says_how_many_and_why():
    assert 'not registered: no texture' in describe(
        result_with(status=NOT_REGISTERED, reason='no texture')
    )
    text = describe(result_with([box('change', 60, 80), box('static', 200, 80, 0.8)]))
    assert '1 change ' in text
    assert '1 static object ' in text
    assert '42 rows' in text


def test_sheet_holds_pictures_of_any_size(live):
    red = np.full((120, 160, 3), (0, 0, 255), np.uint8)
    picture = contact_sheet({'reference': red, 'live': live, 'overlay': live})
    rows, cols = picture.shape[0] / 2, picture.shape[1] / 2
    assert rows >= 240
    assert cols >= 320
    assert (picture[int(0.6 * rows), int(0.5 * cols)] == (0, 0, 255)).all()  # fitted to 320 x 240
    assert (picture[int(0.6 * rows), int(1.5 * cols)] == 128).all()
    assert (picture[int(1.6 * rows), int(0.5 * cols)] == 128).all()
    assert (picture[int(1.6 * rows), int(1.5 * cols)] == 255).all()  # no fourth picture


def test_page_holds_its_pictures_and_needs_no_network(tmp_path, live):
    report = Report('a <flight>', total=3)
    for index in range(3):
        report.add(index, f'frame {index}', 'fine', {'live': live, 'overlay': live})
    report.write(tmp_path / 'r.html', {'frames': '3'}, [Table('objects', ('name',), [('car',)])])
    page = (tmp_path / 'r.html').read_text('utf-8')
    assert 'a &lt;flight&gt;' in page
    assert not re.search(r'(src|href)="(?!data:|#)', page)
    data = re.search(r'data:image/jpeg;base64,([A-Za-z0-9+/=]+)', page).group(1)
    shown = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)
    assert abs(int(shown[100, 100, 0]) - 128) <= 2
    assert page.count('frame 2') >= 1
    assert 'car' in page


def test_shown_frames_are_spread_over_the_flight():
    assert evenly(3, 6) == {0, 1, 2}
    chosen = sorted(evenly(100, 6))
    assert len(chosen) == 6
    assert chosen[-1] == 99
    assert max(np.diff(chosen)) <= 21
