"""Folders with truth: what is written is read back, and what does not fit is refused by name."""

import json

import cv2
import numpy as np
import pytest

from rsmb_ros.cli.truth_folder import cases_in, count_in, write_frame, write_truth
from rsmb_ros.core.errors import FileProblem
from rsmb_ros.evaluation.suites.nuisances import Range
from rsmb_ros.evaluation.suites.recipe import Recipe, simulated
from rsmb_ros.evaluation.suites.scouts import drawn_scout
from rsmb_ros.evaluation.suites.simulated import HOUSES

ROWS, COLS = 240, 320
DISTORTION = 0.02  # 3.2 px at half the width


def small_motion(distortion):
    """A case with a house whose rows are blurred by 1.5 to 2.5 px."""
    recipe = Recipe(
        style=HOUSES,
        blur_px=(3.0, 5.0),  # for 640 px of width
        motions=('smooth',),
        nuisances={'distortion': Range(1.0, distortion, distortion)},
    )
    rng = np.random.default_rng(3)
    return simulated('small/00', recipe, (ROWS, COLS), 0, rng, drawn_scout((ROWS, COLS)))


@pytest.fixture(scope='module', params=[0.0, DISTORTION], ids=['straight', 'distorted'])
def case(request):
    """A synthetic case."""
    return small_motion(request.param)


@pytest.fixture(scope='module')
def straight():
    """A synthetic case without distortion."""
    return small_motion(0.0)


@pytest.fixture
def written(straight, tmp_path):
    """Return the folder of a case, in a folder of its own."""
    return write(tmp_path / 'mine', straight)


def write(folder, *cases):
    folder.mkdir()
    entries = [write_frame(folder, number, case) for number, case in enumerate(cases)]
    write_truth(folder, cases[0].reference, {'focal_px': cases[0].focal_px}, entries)
    return folder


def only(folder):
    (case,) = cases_in(folder)
    return case


def refusal(folder):
    """Return what is told; `cases_in` works lazily, so all cases are asked for."""
    with pytest.raises(FileProblem) as caught:
        list(cases_in(folder))
    return str(caught.value)


def edit(folder, change):
    """Alter truth.json: `change` takes its content and its first entry."""
    path = folder / 'truth.json'
    content = json.loads(path.read_text())
    change(content, content['frames'][0])
    path.write_text(json.dumps(content))


def save(path, image):
    assert cv2.imwrite(str(path), image)


# -- written and read back -----------------------------------------------------------------------


def test_written_case_reads_back_equal(case, tmp_path):
    found = only(write(tmp_path / 'mine', case))
    assert found.name == 'mine/000'
    assert (found.changed, found.focal_px) == (True, case.focal_px)
    for name in ('reference', 'live', 'label', 'objects'):
        np.testing.assert_array_equal(getattr(found, name), getattr(case, name))
    np.testing.assert_array_equal(found.motion.layers, case.motion.layers)
    assert found.motion.layers.any()
    np.testing.assert_allclose(found.motion.centroids, case.motion.centroids, atol=5.1e-6)
    assert found.motion.depths == case.motion.depths
    assert found.motion.exposure_rows == case.motion.exposure_rows
    assert case.about.items() <= found.about.items()


def test_places_are_those_of_the_truth(case, tmp_path):
    """
    The file holds one pose a row, the truth the mean over its exposure.

    They differ by what rotation, zoom and tilt do within 2 px of blur: some thousandths of a pixel.
    """
    found = only(write(tmp_path / 'mine', case))
    error = np.linalg.norm(found.motion.places - case.motion.places, axis=2)
    assert error.max() < 0.05  # px


def test_frames_are_read_in_order(straight, tmp_path):
    folder = write(tmp_path / 'mine', straight, straight)
    assert count_in(folder) == 2
    assert [case.name for case in cases_in(folder)] == ['mine/000', 'mine/001']


def test_folders_in_a_folder_are_read_one_by_one(straight, tmp_path):
    for name in ('b', 'a'):
        write(tmp_path / name, straight)
    (tmp_path / 'notes.txt').write_text('mine')
    (tmp_path / 'empty').mkdir()
    assert count_in(tmp_path) == 2
    names = [f'{tmp_path.name}/a 000', f'{tmp_path.name}/b 000']
    assert [case.name for case in cases_in(tmp_path)] == names


def test_folder_one_stands_in_has_its_name(written, monkeypatch):
    monkeypatch.chdir(written)
    assert only(type(written)('.')).name == 'mine/000'


# -- a folder of one's own -----------------------------------------------------------------------


@pytest.fixture
def own(tmp_path, texture_of):
    """Return a folder with images and labels only: two changes, one unsure, one outside."""
    label = np.zeros((60, 80), np.uint8)
    label[5:15, 10:30] = label[40:50, 60:70] = 255
    label[20:24] = 170
    label[56:] = 85
    save(tmp_path / 'reference.png', texture_of(64, 90, 1))
    save(tmp_path / 'live_a.png', texture_of(60, 80, 2))
    save(tmp_path / 'truth_a.png', label)
    return tmp_path


def test_own_folder_needs_no_truth_json(own):
    found = only(own)
    assert (found.motion, found.focal_px, dict(found.about)) == (None, None, {})
    np.testing.assert_array_equal(found.label, cv2.imread(str(own / 'truth_a.png'), -1))


def test_objects_of_an_own_folder_are_its_connected_changes(own):
    found = only(own)
    assert np.unique(found.objects[5:15, 10:30]).tolist() == [1]
    assert np.unique(found.objects[40:50, 60:70]).tolist() == [2]
    assert not found.objects[found.label != 255].any()


def test_frame_that_truth_json_does_not_name_has_no_motion(written, straight):
    for kind in ('live', 'truth'):
        (written / f'{kind}_007.png').write_bytes((written / f'{kind}_000.png').read_bytes())
    first, other = cases_in(written)
    assert first.motion is not None
    assert (other.name, other.motion, other.focal_px) == ('mine/007', None, straight.focal_px)


def test_unknown_exposure_is_nan(written):
    edit(written, lambda content, entry: entry.pop('exposure_rows'))
    assert np.isnan(only(written).motion.exposure_rows)


# -- what does not fit ---------------------------------------------------------------------------


def test_missing_folder_is_named(tmp_path):
    assert refusal(tmp_path / 'gone') == f'{tmp_path / "gone"}: no such folder and no suite'


def test_folder_without_reference_says_how_to_make_one(written):
    (written / 'reference.png').unlink()
    told = refusal(written)
    assert told.startswith(f'{written}: holds no reference.png, nor does a folder in it')
    assert f'`rsmb synth -o {written}` makes one' in told


def test_folder_without_live_frames_is_named(written):
    (written / 'live_000.png').unlink()
    assert refusal(written) == f'{written}: holds no live_*.png'
    with pytest.raises(FileProblem, match=r'holds no live_\*\.png'):
        count_in(written)


def test_frame_without_truth_is_named(written):
    (written / 'truth_000.png').unlink()
    told = f'{written / "live_000.png"}: has no truth, truth_000.png is missing'
    assert refusal(written) == told


@pytest.mark.parametrize('kind', ['truth', 'objects', 'layers'])
@pytest.mark.parametrize('shape', [(ROWS, COLS - 1), (ROWS, COLS, 3)])
def test_map_of_another_size_is_named_with_both(written, kind, shape):
    save(written / f'{kind}_000.png', np.zeros(shape, np.uint8))
    size = ' x '.join(map(str, shape))
    told = f'{kind}_000.png: is {size}, must be one channel of {ROWS} x {COLS} like its live frame'
    assert refusal(written).endswith(told)


def test_odd_labels_are_named(written):
    label = np.zeros((ROWS, COLS), np.uint8)
    label[:2, 0] = 1, 254
    save(written / 'truth_000.png', label)
    told = f'{written / "truth_000.png"}: holds labels [1, 254], must be of (0, 85, 170, 255)'
    assert refusal(written) == told


def test_layer_without_a_depth_is_named(written):
    save(written / 'layers_000.png', np.full((ROWS, COLS), 9, np.uint8))
    assert f'{written / "layers_000.png"}: holds layer 9 of ' in refusal(written)


@pytest.mark.parametrize(
    ('change', 'told'),
    [
        (
            lambda content, entry: entry.update(centroids=entry['centroids'][1:]),
            f'frame 000 has centroids of shape ({ROWS - 1}, 6), must be ({ROWS}, 6)',
        ),
        (
            lambda content, entry: entry.update(centroids=[[1, 2], [3]]),
            'frame 000 centroids: [[1, 2], [3]] are no numbers',
        ),
        (
            lambda content, entry: entry['centroids'][3].__setitem__(0, float('nan')),
            'frame 000 has centroids that are not finite',
        ),
        (
            lambda content, entry: content.pop('focal_px'),
            'frame 000 has centroids, which need focal_px',
        ),
        (
            lambda content, entry: content.update(focal_px=-3),
            'focal_px is -3, must be above 0',
        ),
        (
            lambda content, entry: content.update(focal_px='wide'),
            'focal_px: wide are no numbers',
        ),
        (
            lambda content, entry: entry.update(depths=[[0.9]]),
            'frame 000 has depths of shape (1, 1), must be a list',
        ),
        (
            lambda content, entry: entry.update(exposure_rows='long'),
            'frame 000 exposure_rows: long are no numbers',
        ),
        (
            lambda content, entry: entry['nuisances'].update(distortion='much'),
            'frame 000 distortion: much are no numbers',
        ),
        (
            lambda content, entry: content.update(frames=3),
            'must hold an object with a list of frames, each with a number',
        ),
        (
            lambda content, entry: entry.pop('frame'),
            'must hold an object with a list of frames, each with a number',
        ),
    ],
)
def test_truth_that_does_not_fit_is_named(written, change, told):
    edit(written, change)
    found = refusal(written)
    assert found.startswith(f'{written / "truth.json"}: ')
    assert told in found


@pytest.mark.parametrize('text', ['{"frames": [', '', 'no json', '[1, 2]'])
def test_broken_truth_is_named(written, text):
    (written / 'truth.json').write_text(text)
    assert refusal(written).startswith(f'{written / "truth.json"}: ')


def test_picture_that_is_no_image_is_named(written):
    (written / 'live_000.png').write_bytes(b'text')
    assert refusal(written).startswith(f'{written / "live_000.png"}: not an image: ')
