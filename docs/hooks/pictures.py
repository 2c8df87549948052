"""
Draw the pictures of the pages, from the demo bag and the code as it is.

    PYTHONPATH=docs/hooks python docs/hooks/pictures.py

Run by hand when the method or the bag has changed; the pictures lie in docs/images.
"""

from __future__ import annotations

import json
from pathlib import Path
from unittest.mock import patch

import cv2
import numpy as np

from rsmb_ros.bags.reading import Bag
from rsmb_ros.core import Camera, Config, Detector, Result
from rsmb_ros.core.change_finder import ChangeFinder, Finding
from rsmb_ros.core.evidence import Texture
from rsmb_ros.core.motion import Grid
from rsmb_ros.evaluation.warping import pixel_grid, places_of_poses
from rsmb_ros.report.overlay import draw_overlay

ROOT = Path(__file__).parents[2]
IMAGES = ROOT / 'docs' / 'images'
FRAME = 12  # both new objects, both houses, a lot of shake
WIDTH = 640  # px of a picture; two stand beside each other on a wide page
QUALITY = 78
BRIGHT = 10.0  # sigma, or grey levels, at the bright end of the maps


def main() -> None:
    """Write every picture."""
    with Bag(ROOT / 'bags' / 'demo.mcap') as bag:
        reference = next(frame.image for frame in bag.frames('/reference/image/compressed'))
        live = [frame.image for frame in bag.frames('/image/compressed')][FRAME]
        scenes = [json.loads(message.data) for _, _, message in bag.messages('/truth/scene')]
        focal_px = bag.focal_px()
    camera = None if focal_px is None else Camera(focal_px)
    found: list[Finding] = []
    find = ChangeFinder.find

    def noting(*given: object) -> Finding:
        found.append(find(*given))  # type: ignore
        return found[-1]

    with patch.object(ChangeFinder, 'find', noting):
        result = Detector(reference, camera).detect(live)
    flat = Detector(reference, camera, Config.from_mapping({'layers.enabled': False})).detect(live)
    _frame(reference, live, result)
    _evidence(found[-1])
    _layers(live, result, flat)
    grid = Grid(
        live.shape[:2], reference.shape[:2], focal_px or Camera.guess(live.shape[1]).focal_px
    )
    truth = np.array(scenes[FRAME]['centroids'])
    moves = [_row_moves(poses, grid) for poses in (result.row_motion, truth)]
    text = row_plot(*moves, result.valid_mask.any(axis=1))
    (IMAGES / 'row-motion.svg').write_text(text, 'utf-8')


def _frame(reference: np.ndarray, live: np.ndarray, result: Result) -> None:
    _write('reference', reference)
    _write('live', live)
    _write('registered', result.registered)
    _write('rectified', result.rectified)
    _write('residual', _heat(np.abs(result.residual), BRIGHT * 4))
    _write('valid-mask', result.valid_mask)
    _write('change-mask', result.change_mask)
    _write('overlay', draw_overlay(live, result))


def _evidence(finding: Finding) -> None:
    frame, seen = finding.frame, finding.seen
    sigma = seen.noise(Texture.of(frame.predicted))
    _write('expected-noise', _heat(sigma, BRIGHT))
    _write('evidence', _heat(seen.strength, BRIGHT))


def _layers(live: np.ndarray, result: Result, flat: Result) -> None:
    """Cut out one house, with layers and without."""
    house = max((one for one in result.regions if one.kind == 'static'), key=lambda one: one.area)
    top, left = max(0, house.y - 50), max(0, house.x - 70)
    box = np.s_[top : house.y + house.height + 50, left : house.x + house.width + 70]
    for name, one in (('with-layers', result), ('without-layers', flat)):
        _write(name, draw_overlay(live, one)[box])


def _heat(values: np.ndarray, full: float) -> np.ndarray:
    scaled = np.clip(values / full * 255.0, 0, 255).astype(np.uint8)
    return cv2.applyColorMap(scaled, cv2.COLORMAP_INFERNO)


def _write(name: str, image: np.ndarray) -> None:
    height = round(image.shape[0] * WIDTH / image.shape[1])
    way = cv2.INTER_AREA if image.shape[1] > WIDTH else cv2.INTER_CUBIC
    small = cv2.resize(image, (WIDTH, height), interpolation=way)
    path = IMAGES / f'{name}.jpg'
    cv2.imwrite(str(path), small, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])


def _row_moves(poses: np.ndarray, grid: Grid) -> np.ndarray:
    """Return how far the pixels of each row are moved, mean x and y (M, 2) [px]."""
    columns, rows = pixel_grid(grid.live_shape)
    own = np.stack(np.broadcast_arrays(columns, rows), axis=-1)
    return (places_of_poses(poses, grid) - own).mean(axis=1)


def row_plot(found: np.ndarray, truth: np.ndarray, judged: np.ndarray) -> str:
    """Return an SVG of each row's motion (M, 2) over the truth; errors of `judged` rows (M,)."""
    rows = len(truth)
    lanes = [
        _lane(found[:, n], truth[:, n], judged, 60 + 250 * n, label)
        for n, label in enumerate(('to the right', 'down'))
    ]
    marks = ''.join(
        f'<text x="48" y="{_y(row, rows) + 4:.0f}" text-anchor="end">{row}</text>'
        for row in range(0, rows, 120)
    )
    legend = (
        '<path d="M60 352h26" class="truth"/><text x="92" y="356">truth</text>'
        '<path d="M150 352h26" class="found"/><text x="182" y="356">estimated</text>'
    )
    style = (
        'text{font:11px system-ui,sans-serif;fill:#607080}.truth{stroke:#f0a030;stroke-width:6;'
        'fill:none;opacity:.55}.found{stroke:#3f51b5;stroke-width:1.6;fill:none}'
        '.frame{fill:none;stroke:#9aa7b0}'
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 570 370"><style>{style}</style>'
        f'<rect width="570" height="370" fill="#fff"/><text x="14" y="26">row</text>{marks}'
        f'{"".join(lanes)}{legend}</svg>\n'
    )


def _lane(found: np.ndarray, truth: np.ndarray, judged: np.ndarray, left: int, label: str) -> str:
    both = np.concatenate([found, truth])
    pad = 0.08 * float(np.ptp(both))
    low, high = float(both.min()) - pad, float(both.max()) + pad

    def points(values: np.ndarray) -> str:
        return ' '.join(
            f'{left + 230 * (value - low) / (high - low):.1f},{_y(row, len(values)):.1f}'
            for row, value in enumerate(values)
            if row % 3 == 0 or row == len(values) - 1
        )

    error = float(np.sqrt(((found - truth)[judged] ** 2).mean()))
    ends = f'{both.min():.1f} to {both.max():.1f} px'
    return (
        f'<rect class="frame" x="{left}" y="36" width="230" height="290"/>'
        f'<polyline class="truth" points="{points(truth)}"/>'
        f'<polyline class="found" points="{points(found)}"/>'
        f'<text x="{left}" y="26">{label}: {ends}</text>'
        f'<text x="{left + 230}" y="342" text-anchor="end">RMSE {error:.3f} px</text>'
    )


def _y(row: int, rows: int) -> float:
    return 36 + 290 * row / (rows - 1)


if __name__ == '__main__':
    main()
