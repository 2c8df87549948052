"""Suites on real pictures: photos as ground, a real revisit, a video of a road."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from rsmb_ros.core.camera import Camera
from rsmb_ros.core.errors import FileProblem
from rsmb_ros.core.motion import Grid
from rsmb_ros.core.synthesis import NEW, Scene, Sheet, Style, live_frame
from rsmb_ros.core.synthesis.sensor import Nuisances
from rsmb_ros.evaluation.case import Case

from .nuisances import ALL, described, drawn
from .recipe import Recipe, case_of, fly, margin_of, simulated
from .scouts import photo_scout
from .simulated import quiet
from .suite import Suite, Wish, data_of, seeded, wished

PHOTOS = 'aerial/*.jpg'
REVISIT = ('caliterra_9408', 'caliterra_9425')  # the same ground 30 s apart, nothing changed
PHOTO_FILES = (PHOTOS, *(f'aerial/{name}.jpg' for name in REVISIT))
REVISIT_SCALE = 0.5
VIDEO = 'video/elevated_road_640x360.avi'
VIDEO_FRAMES = tuple(range(40, 370, 20))
# Moving vehicles of the undistorted frame: |frame - reference| in the strongest colour, smoothed.
SURE, POSSIBLE = 28.0, 11.0  # grey levels: changed; perhaps, not counted
SMOOTHING = 1.2  # px
MIN_VEHICLE = 90  # px
RIM_PX = 4  # around a vehicle, not counted

_ROOFS = Style(houses=2, roof_depth=(0.75, 0.97))
_RECIPES = (
    Recipe(),
    Recipe(style=_ROOFS),
    quiet(Recipe(style=_ROOFS)),
    quiet(Recipe(regimes=('RS', 'GSMB'))),
)
_PHOTO_CASES = 24
# The video has its own noise and compression; the camera that looks at it adds its own. What bends
# or clips the reference too is left out: frame 0 is taken as it is.
_OF_BOTH = ('overexposure', 'distortion')
_VIDEO_NUISANCES = {name: spread for name, spread in ALL.items() if name not in _OF_BOTH}
_VIDEO_RECIPE = Recipe(offset=(0.0, 0.03), nuisances=_VIDEO_NUISANCES)


def photos_suite() -> Suite:
    """Return cut-outs of real photos as ground, and the real revisit both ways."""
    return Suite(
        'photos',
        'real aerial photos as ground; a real revisit in which nothing changed',
        _photo_cases,
        _PHOTO_CASES + 2,
        (described(ALL), 'the revisit is as it is, at half size'),
        needs=PHOTO_FILES,
    )


def video_suite() -> Suite:
    """Return frames of a video of a road, taken again by a moving camera."""
    return Suite(
        'video',
        'a real road: frame 0 is the reference, vehicles in later frames are the changes',
        _video_cases,
        len(VIDEO_FRAMES),
        (described(_VIDEO_RECIPE.nuisances),),
        needs=(VIDEO,),
    )


def _photo_cases(wish: Wish) -> Iterator[Case]:
    data = data_of(wish, 'photos', PHOTO_FILES)
    photos = {path.stem: _read(path) for path in sorted(data.glob(PHOTOS))}
    shape = wish.shape or (480, 640)
    grounds = list(photos.values())
    count = min(_PHOTO_CASES, wish.first or _PHOTO_CASES)
    for n in range(count):
        recipe = wished(_RECIPES[n % len(_RECIPES)], wish)
        # every photo meets every recipe in turn
        scout = photo_scout(shape, grounds, n + n // len(grounds))
        yield simulated(
            f'photos/{n:02d}', recipe, shape, n // len(_RECIPES), seeded('photos', n), scout
        )
    pair = [_half(photos[name]) for name in REVISIT]
    for n, (reference, live) in enumerate((pair, pair[::-1])):
        if count + n < (wish.first or _PHOTO_CASES + 2):
            nothing = np.zeros(live.shape[:2], np.uint8)
            about = {'reference': REVISIT[n], 'live': REVISIT[1 - n]}
            name = f'photos/{"-".join(part[-4:] for part in (REVISIT[n], REVISIT[1 - n]))}'
            yield Case(name, reference, live, nothing, nothing.copy(), about=about)


def _video_cases(wish: Wish) -> Iterator[Case]:
    frames = _frames(data_of(wish, 'video', (VIDEO,)) / VIDEO, (0, *VIDEO_FRAMES))
    reference = frames[0]
    # `all` are those that frame 0 allows
    recipe = wished(_VIDEO_RECIPE, wish) if wish.nuisances == 'none' else _VIDEO_RECIPE
    for n, number in enumerate(VIDEO_FRAMES[: wish.first]):
        yield _video_case(recipe, reference, frames[number], n, number)


def _video_case(
    recipe: Recipe, reference: np.ndarray, frame: np.ndarray, n: int, number: int
) -> Case:
    rng = seeded('video', n)
    shape = reference.shape[:2]
    flown = fly(recipe, shape, n, rng)
    grid = Grid(shape, shape, Camera.guess(shape[1]).focal_px)
    margin = min(margin_of(flown, grid), min(shape) - 1)
    scene = Scene(cv2.copyMakeBorder(frame, *[margin] * 4, cv2.BORDER_REFLECT_101), margin)
    nuisances: Nuisances = drawn(recipe.nuisances, rng)
    live, truth = live_frame(
        scene, vehicles(reference, frame), grid, flown.path, flown.timing, nuisances, rng
    )
    about = {**flown.about, 'objects': list(truth.names), 'nuisances': nuisances.as_dict()}
    case = case_of(f'video/{number:03d}', reference, live, truth, grid.focal_px, about)
    assert case.motion is not None
    return replace(case, motion=replace(case.motion, clean=None))  # it holds the vehicles


def vehicles(reference: np.ndarray, frame: np.ndarray) -> tuple[Sheet, ...]:
    """
    Return what moves in an undistorted frame as sheets that look as the frame does.

    By differencing: what differs by `SURE` and is at least `MIN_VEHICLE` px large is a vehicle;
    its rim and what differs by `POSSIBLE` is a sheet marked as a shadow, which truth leaves out.
    """
    difference = np.abs(frame.astype(np.float32) - reference).max(axis=2)
    difference = cv2.GaussianBlur(difference, (0, 0), SMOOTHING)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (9, 9))
    sure = cv2.morphologyEx((difference > SURE).astype(np.uint8), cv2.MORPH_CLOSE, disc)
    outlines, _ = cv2.findContours(sure, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    masks = []
    for outline in outlines:
        mask = cv2.drawContours(np.zeros_like(sure), [outline], -1, 1, cv2.FILLED)
        if np.count_nonzero(mask) >= MIN_VEHICLE:
            masks.append(mask)
    found = np.maximum.reduce([np.zeros_like(sure), *masks])
    rim = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * RIM_PX + 1,) * 2)
    unsure = cv2.dilate(np.maximum(found, (difference > POSSIBLE).astype(np.uint8)), rim)
    unsure[found > 0] = 0
    doubt = Sheet(frame, unsure.astype(np.float32), 0.0, 0.0, name='doubt', kind=NEW, shadow=True)
    return (
        doubt,
        *(
            Sheet(frame, mask.astype(np.float32), 0.0, 0.0, name=f'vehicle {n}', kind=NEW)
            for n, mask in enumerate(masks, 1)
        ),
    )


def _read(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    if image is None:
        raise FileProblem(f'{path}: not an image')
    return image


def _half(image: np.ndarray) -> np.ndarray:
    return cv2.resize(image, None, fx=REVISIT_SCALE, fy=REVISIT_SCALE, interpolation=cv2.INTER_AREA)


def _frames(path: Path, wanted: tuple[int, ...]) -> dict[int, np.ndarray]:
    """Return the wanted frames of a video."""
    capture = cv2.VideoCapture(str(path))
    found = {}
    for number in range(max(wanted) + 1):
        ok, frame = capture.read()
        if not ok:
            capture.release()
            raise FileProblem(f'{path}: ends or breaks at frame {number}, {max(wanted)} needed')
        if number in wanted:
            found[number] = frame
    capture.release()
    return found
