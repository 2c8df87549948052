"""What lasts is reported, under one name; what flickers is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rsmb_ros.core import Camera, Config, Detector
from rsmb_ros.core import persistence as persistence_module
from rsmb_ros.core.motion import Grid, still_path
from rsmb_ros.core.persistence import RegionMemory
from rsmb_ros.core.segmentation import Blob
from rsmb_ros.core.shutter import ShutterTiming
from rsmb_ros.core.synthesis import Nuisances, Scene, live_frame, reference_image
from rsmb_ros.core.synthesis.paths import Hover

SHAPE = (240, 320)
CAMERA = Camera(300.0)
GRID = Grid(SHAPE, SHAPE, CAMERA.focal_px)
REAL = Nuisances(gain=1.12, vignetting=0.1, noise_electrons=9000, read_noise=0.3, jpeg_quality=92)
ALL = np.ones(SHAPE, bool)


def settings(seen, frames):
    return Config.from_mapping(
        {'change.persistence_seen': seen, 'change.persistence_frames': frames}
    )


def memory(seen=3, frames=5):
    return RegionMemory(settings(seen, frames).change)


def path_at(x=0.0, y=0.0):
    """Path of a frame that lies `x`, `y` px right of and below the reference."""
    path = still_path(GRID, 24.0, 2.0, 16.0, bottom_up=False)
    path.control[:, :2] = x, y
    return path


def block(x, y, width=20, height=12):
    """Return a rectangle, by its place on the reference or in a frame at (0, 0)."""
    return Blob(np.ones((height, width), bool), x, y)


HOME = path_at()


# -- the memory alone --------------------------------------------------------------------------


def test_region_is_confirmed_by_n_of_the_last_m_frames():
    remembered = memory(3, 5)
    shown = [True, False, True, False, True, False, False, True, True]
    confirmed = []
    for seen in shown:
        known = remembered.update([block(50, 60)] if seen else [], HOME, ALL)
        confirmed.append(bool(known and known[0]))
    # frames 0, 2, 4 make three of five; at 7 only 4 and 7 are left, at 8 three again
    assert confirmed == [False, False, False, False, True, False, False, False, True]


def test_place_is_that_on_the_reference_however_the_camera_moves():
    remembered = memory(2, 3)
    for n, (x, y) in enumerate([(0, 0), (60, -40), (-80, 30)]):
        frame = path_at(x, y)
        (known,) = remembered.update([block(150 - x, 100 - y)], frame, ALL, stamp=70 + n)
    assert (known.id, known.first_seen) == (1, 70)
    np.testing.assert_allclose((known.reference_x, known.reference_y), (159.5, 105.5), atol=1e-6)
    # the same pixels of the live frame are another place
    assert remembered.update([block(150, 100)], path_at(40, 0), ALL) == [None]


def test_frame_that_does_not_judge_the_place_counts_neither_way():
    remembered = memory(3, 3)
    blind = ALL.copy()
    blind[55:75, 45:75] = False
    elsewhere = path_at(200.0)  # the place is outside such a frame
    seen = [block(50, 60)]
    assert remembered.update(seen, HOME, ALL) == [None]
    assert remembered.update(seen, HOME, ALL) == [None]
    for _ in range(10):
        remembered.update([], HOME, blind)
        remembered.update([], elsewhere, ALL)
    (known,) = remembered.update(seen, HOME, ALL)
    assert known.id == 1
    # whereas a frame that looked and saw nothing does count
    remembered.update([], HOME, ALL)
    assert remembered.update(seen, HOME, ALL) == [None]


def test_near_objects_keep_their_ids_though_they_merge_and_part():
    remembered = memory(2, 4)
    left, right = block(50, 60), block(72, 60)
    both = block(50, 60, width=42)
    for _ in range(3):
        first = [known and known.id for known in remembered.update([left, right], HOME, ALL)]
    assert first == [1, 2]
    for _ in range(5):
        (merged,) = remembered.update([both], HOME, ALL)
        assert merged.id in (1, 2)
    apart = remembered.update([right, left], HOME, ALL)
    assert [known.id for known in apart] == [2, 1]


def test_objects_that_look_like_one_for_a_while_are_both_seen():
    remembered = memory(3, 5)
    left, right = block(50, 60), block(72, 60)
    for found in ([left, right], [block(50, 60, width=42)], [left, right]):
        known = remembered.update(found, HOME, ALL)
    assert [one.id for one in known] == [1, 2]


def test_object_that_has_gone_is_not_seen_in_the_one_it_had_merged_with():
    remembered = memory(2, 4)
    left, right = block(50, 60), block(72, 60)
    for found in ([left, right], [left, right], [block(50, 60, width=42)]):
        remembered.update(found, HOME, ALL)
    for _ in range(5):
        assert remembered.update([left], HOME, ALL)[0]
    known, new = remembered.update([left, right], HOME, ALL)
    assert known.id == 1
    assert new is None


def test_pieces_of_a_confirmed_object_are_no_news():
    remembered = memory(3, 5)
    for stamp in range(4):
        (whole,) = remembered.update([block(50, 60, width=40)], HOME, ALL, stamp)
    pieces = [block(50, 60, width=25), block(78, 60, width=12)]
    one, other = remembered.update(pieces, HOME, ALL, 4)
    assert one.id == whole.id != other.id
    assert one.first_seen == other.first_seen == 0
    remembered.update([block(50, 60, width=8)], HOME, ALL, 5)
    (again,) = remembered.update([block(50, 60, width=40)], HOME, ALL, 6)
    assert again.id == whole.id


def test_large_flicker_over_a_small_object_is_not_taken_for_it():
    remembered = memory(2, 5)
    small, large = block(50, 60), block(20, 20, width=120, height=100)
    for _ in range(3):
        (known,) = remembered.update([small], HOME, ALL)
    assert remembered.update([large], HOME, ALL) == [None]
    assert remembered.update([small], HOME, ALL) == [known]


def test_memory_is_bounded_and_forgets_what_does_not_last(monkeypatch):
    monkeypatch.setattr(persistence_module, 'MOST_REGIONS', 10)
    remembered = memory(2, 3)
    nothing = np.zeros(SHAPE, bool)  # never looked at again: never missed
    for n in range(40):
        remembered.update([block(7 * n % 280, 200 - 4 * n, 6, 3)], HOME, nothing)
        assert len(remembered) <= 10
    for _ in range(4):
        remembered.update([], HOME, ALL)
    assert len(remembered) == 0


def test_id_is_given_when_a_region_is_confirmed():
    """The flicker before it takes no number away."""
    remembered = memory(2, 3)
    for n in range(5):
        remembered.update([block(10 + 30 * n, 150)], HOME, ALL)
    for _ in range(2):
        known = remembered.update([block(50, 60)], HOME, ALL)
    assert known[0].id == 1


# -- through the detector ----------------------------------------------------------------------


def scene_of(texture):
    return Scene(texture, margin=40)


@pytest.fixture(scope='module')
def stream(texture_of):
    """Reference, six unchanged frames and six that show a car, of one hovering drone."""
    texture = texture_of(SHAPE[0] + 80, SHAPE[1] + 80, 21)
    changed = texture.copy()
    changed[140:162, 170:204] = 250 - changed[140:162, 170:204] // 4
    hover = Hover(14.0, 6.0, 30.0, line_delay=6e-5, phase=0.7)
    rng = np.random.default_rng(43)
    reference = reference_image(scene_of(texture), REAL, rng)
    frames = []
    for n in range(12):
        live, _ = live_frame(
            scene_of(changed if n >= 6 else texture), (), GRID,
            lambda rows, t=0.3 * n: hover.poses(t, rows), ShutterTiming(30.0), REAL, rng,
        )  # fmt: skip
        frames.append(live)
    return reference, frames


def flickering(live):
    """A live frame with a dark thing painted in that no other frame shows."""
    live = live.copy()
    live[50:66, 60:85] = 20
    return live


def test_what_stays_is_reported_from_the_nth_frame_on_and_what_flickers_never(stream):
    reference, frames = stream
    frames = [flickering(live) if n in (2, 8) else live for n, live in enumerate(frames)]
    alone = [Detector(reference, CAMERA).detect(frames[n]) for n in (2, 8)]
    assert [len(result.changes) for result in alone] == [1, 2], 'else there is nothing to hold back'
    detector = Detector(reference, CAMERA, settings(3, 5))
    results = [detector.detect(live, stamp=100 + n) for n, live in enumerate(frames)]
    assert [len(result.changes) for result in results] == [0] * 8 + [1] * 4
    assert not any(result.change_mask.any() for result in results[:8])
    for result in results[8:]:
        (car,) = result.changes
        assert (car.id, car.first_seen) == (1, 106)
        # its box on the texture is 34 x 22 px at (170, 140), the reference starts at (40, 40)
        place = (car.reference_x, car.reference_y)
        np.testing.assert_allclose(place, (146.5, 110.5), atol=1.0)  # px: its outline's blur
        rows, cols = np.nonzero(result.change_mask)
        assert (cols.min(), rows.min()) == (car.x, car.y)
        assert len(rows) == car.area
    moved = np.ptp([(r.changes[0].x, r.changes[0].y) for r in results[8:]], axis=0)
    assert moved.max() > 5, 'px: the camera must have moved, or its place says nothing'


def test_frames_that_cannot_be_registered_count_neither_way(stream):
    reference, frames = stream
    detector = Detector(reference, CAMERA, settings(3, 3))
    blank = np.full(SHAPE, 90, np.uint8)
    found = []
    for live in (frames[6], blank, frames[7], blank, blank, frames[8]):
        found.append(len(detector.detect(live).changes))
    assert found == [0, 0, 0, 0, 0, 1]
    assert detector.detect(frames[9]).changes[0].first_seen is None, 'no stamps were given'


def test_off_is_each_frame_alone_and_one_of_m_only_adds_names(stream):
    reference, frames = stream
    plain, named = Detector(reference, CAMERA), Detector(reference, CAMERA, settings(1, 5))
    for n in (5, 6, 7):
        result, other = plain.detect(frames[n], stamp=n), named.detect(frames[n], stamp=n)
        for name in ('change_mask', 'valid_mask', 'residual', 'row_motion'):
            np.testing.assert_array_equal(getattr(result, name), getattr(other, name))
        nameless = {'id': None, 'first_seen': None, 'reference_x': None, 'reference_y': None}
        assert result.regions == tuple(replace(one, **nameless) for one in other.regions)
        assert [region.id for region in other.regions] == [1] * (n > 5)
        assert 'persistence' not in result.timings_ms


def test_new_detector_remembers_nothing(stream):
    reference, frames = stream
    first, second = (Detector(reference, CAMERA, settings(2, 3)) for _ in range(2))
    assert not first.detect(frames[6]).changes
    assert not second.detect(frames[7]).changes
    assert first.detect(frames[7]).changes
