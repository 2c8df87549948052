"""Folders with images and truth, as `rsmb synth` writes them and `rsmb evaluate` reads them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rsmb_ros.bags.image_files import read_image
from rsmb_ros.core.errors import FileProblem
from rsmb_ros.core.motion import Grid
from rsmb_ros.evaluation.case import Case, TrueMotion
from rsmb_ros.evaluation.warping import places_of_poses
from rsmb_ros.messages.as_json import to_json

from .images import write_png, write_whole

TRUTH = 'truth.json'
REFERENCE = 'reference.png'
LABELS = (0, 85, 170, 255)  # of CDnet


def write_frame(folder: Path, index: int, case: Case) -> dict[str, Any]:
    """Write the images of one live frame; returns its entry in truth.json."""
    write_png(folder / f'live_{index:03d}.png', case.live)
    write_png(folder / f'truth_{index:03d}.png', case.label)
    write_png(folder / f'objects_{index:03d}.png', case.objects)
    entry: dict[str, Any] = {'frame': index, **case.about}
    if case.motion is not None:
        write_png(folder / f'layers_{index:03d}.png', case.motion.layers)
        entry |= {
            'exposure_rows': case.motion.exposure_rows,
            'depths': list(case.motion.depths),
            'centroids': np.round(case.motion.centroids, 5).tolist(),
        }
        if case.motion.path is not None:
            poses = np.round(case.motion.path, 5).tolist()
            entry['path'] = {'first_row': case.motion.path_start, 'poses': poses}
    return entry


def write_truth(
    folder: Path, reference: np.ndarray, about: Mapping[str, Any], frames: list[dict[str, Any]]
) -> None:
    """
    Write the reference and, last, truth.json: a folder with it is complete.

    Frames of an older truth.json that are no part of the new one are removed.
    """
    written = {entry['frame'] for entry in frames}
    for entry in _older_entries(folder / TRUTH):
        if entry['frame'] not in written:
            for kind in ('live', 'truth', 'objects', 'layers'):
                (folder / f'{kind}_{entry["frame"]:03d}.png').unlink(missing_ok=True)
    write_png(folder / REFERENCE, reference)
    write_whole(folder / TRUTH, to_json({**about, 'frames': frames}).encode())


def cases_in(folder: Path) -> Iterator[Case]:
    """
    Yield the cases of a folder, or of the folders in it.

    A folder of one's own needs reference.png, live_NNN.png and truth_NNN.png (CDnet labels: 255
    changed, 0 not, 170 unsure, 85 outside); without truth.json the motion is not scored.

    Raises
    ------
    FileProblem
        If there is no truth, or it does not fit its images.

    """
    found = folders_in(folder)
    for one in found:
        top = folder.resolve().name  # of '.' too
        # one folder or many: all are cases of one table
        yield from _cases(one, f'{top}/' if one == folder else f'{top}/{one.name} ')


def folders_in(folder: Path) -> list[Path]:
    """Return the folders with a reference: this one, else those in it."""
    if not folder.is_dir():
        raise FileProblem(f'{folder}: no such folder and no suite')
    found = [one for one in (folder, *sorted(folder.iterdir())) if (one / REFERENCE).is_file()]
    if not found:
        raise FileProblem(
            f'{folder}: holds no {REFERENCE}, nor does a folder in it; `rsmb synth -o {folder}` '
            'makes one'
        )
    return found[:1] if found[0] == folder else found


def count_in(folder: Path) -> int:
    """Return the number of live frames `cases_in` yields."""
    return sum(len(_lives(one)) for one in folders_in(folder))


def _lives(folder: Path) -> list[Path]:
    lives = sorted(folder.glob('live_*.png'))
    if not lives:
        raise FileProblem(f'{folder}: holds no live_*.png')
    return lives


def _number(live_path: Path) -> int | None:
    number = live_path.stem.removeprefix('live_')
    return int(number) if number.isdigit() else None


def _cases(folder: Path, name: str) -> Iterator[Case]:
    reference = read_image(folder / REFERENCE)
    about = _read_truth(folder / TRUTH)
    entries = {entry.get('frame'): entry for entry in about.get('frames', [])}
    focal = _focal(folder, about)
    for live_path in _lives(folder):
        number = live_path.stem.removeprefix('live_')
        truth_path = folder / f'truth_{number}.png'
        if not truth_path.is_file():
            raise FileProblem(f'{live_path}: has no truth, {truth_path.name} is missing')
        live = read_image(live_path)
        label = _map(truth_path, live)
        odd = sorted(set(np.unique(label).tolist()) - set(LABELS))
        if odd:
            raise FileProblem(f'{truth_path}: holds labels {odd[:5]}, must be of {LABELS}')
        objects_path = folder / f'objects_{number}.png'
        objects = _map(objects_path, live) if objects_path.is_file() else _parts(label)
        entry = entries.get(_number(live_path), {})
        motion = _motion(folder, number, entry, about, live, reference)
        yield Case(f'{name}{number}', reference, live, label, objects, focal, motion, entry)


def _motion(
    folder: Path,
    number: str,
    entry: Mapping[str, Any],
    about: Mapping[str, Any],
    live: np.ndarray,
    reference: np.ndarray,
) -> TrueMotion | None:
    """Return the true motion where the entry tells it."""
    if 'centroids' not in entry:
        return None
    where = f'{folder / TRUTH}: frame {number}'
    rows, cols = live.shape[:2]
    poses = _numbers(where, 'centroids', entry['centroids'], (rows, 6))
    focal = _focal(folder, about)
    if focal is None:
        raise FileProblem(f'{where} has centroids, which need focal_px')
    depths = _numbers(where, 'depths', entry.get('depths', []), None)
    layers_path = folder / f'layers_{number}.png'
    layers = _map(layers_path, live) if layers_path.is_file() else np.zeros((rows, cols), np.uint8)
    if layers.max() > len(depths):
        raise FileProblem(f'{layers_path}: holds layer {layers.max()} of {len(depths)} depths')
    grid = Grid((rows, cols), reference.shape[:2], focal)
    nuisances = entry.get('nuisances') or about.get('nuisances') or {}
    bent = nuisances.get('distortion', 0.0) if isinstance(nuisances, Mapping) else 0.0
    exposure = entry.get('exposure_rows')
    return TrueMotion(
        places=places_of_poses(poses, grid, float(_numbers(where, 'distortion', bent, ()))),
        centroids=poses,
        layers=layers,
        depths=tuple(depths.tolist()),
        exposure_rows=float(
            np.nan if exposure is None else _numbers(where, 'exposure_rows', exposure, ())
        ),
    )


def _focal(folder: Path, about: Mapping[str, Any]) -> float | None:
    """Return the focal length of a folder [px], None: unknown."""
    if about.get('focal_px') is None:
        return None
    focal = float(_numbers(f'{folder / TRUTH}:', 'focal_px', about['focal_px'], ()))
    if focal <= 0:
        raise FileProblem(f'{folder / TRUTH}: focal_px is {focal:g}, must be above 0')
    return focal


def _numbers(where: str, name: str, value: Any, shape: tuple[int, ...] | None) -> np.ndarray:
    """Return finite numbers of a shape, or of any length for None."""
    try:
        array = np.asarray(value, np.float64)
    except (TypeError, ValueError) as error:
        raise FileProblem(f'{where} {name}: {str(value)[:40]} are no numbers') from error
    if array.ndim != 1 if shape is None else array.shape != shape:
        wanted = 'a list' if shape is None else shape
        raise FileProblem(f'{where} has {name} of shape {array.shape}, must be {wanted}')
    if not np.isfinite(array).all():
        raise FileProblem(f'{where} has {name} that are not finite')
    return array


def _map(path: Path, live: np.ndarray) -> np.ndarray:
    image = read_image(path)
    if image.shape != live.shape[:2]:
        raise FileProblem(
            f'{path}: is {" x ".join(map(str, image.shape))}, must be one channel of '
            f'{live.shape[0]} x {live.shape[1]} like its live frame'
        )
    return image


def _parts(label: np.ndarray) -> np.ndarray:
    """Number the connected changes of a label image."""
    _, parts = cv2.connectedComponents((label == 255).astype(np.uint8), connectivity=8)
    return np.minimum(parts, 255).astype(np.uint8)


def _read_truth(path: Path) -> dict[str, Any]:
    if not path.is_file():
        return {}
    try:
        content = json.loads(path.read_text('utf-8'))
    except (OSError, ValueError) as error:
        raise FileProblem(f'{path}: cannot be read: {error}') from error
    frames = content.get('frames', []) if isinstance(content, dict) else None
    if not isinstance(frames, list) or not all(map(_is_entry, frames)):
        raise FileProblem(f'{path}: must hold an object with a list of frames, each with a number')
    return content


def _older_entries(path: Path) -> list[dict[str, Any]]:
    """Return the frames of a truth.json that is about to be replaced, whatever it holds."""
    try:
        return _read_truth(path).get('frames', [])
    except FileProblem:
        return []


def _is_entry(entry: Any) -> bool:
    return isinstance(entry, dict) and isinstance(entry.get('frame'), int)
