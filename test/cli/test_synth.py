"""`rsmb synth`: flights and suites with truth, as files or as a bag."""

import json

import cv2
import numpy as np
import pytest

from rsmb_ros.bags.reading import Bag
from rsmb_ros.core.synthesis import MOTIONS, RIM_COVER
from rsmb_ros.evaluation.suites import SUITES, Wish

SIZE = (240, 320)  # rows, cols: the smallest
SMALL = ('--size', '320x240', '--blur', 3)
GREY = 128  # of the plain photo


def read(path):
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None, f'{path} is no image'
    return image


def truth_in(folder):
    return json.loads((folder / 'truth.json').read_text())


def centroids_in(folder):
    return np.array(truth_in(folder)['frames'][0]['centroids'])


def bytes_in(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def pictures_in(folder):
    return {name: data for name, data in bytes_in(folder).items() if name.endswith('.png')}


@pytest.fixture
def synth(rsmb, tmp_path):
    """Run ``rsmb synth`` on small frames into a folder; returns outcome and folder."""

    def run(*options, name='out'):
        return rsmb('synth', '-o', tmp_path / name, *SMALL, *options), tmp_path / name

    return run


@pytest.fixture
def made(synth):
    """Run ``rsmb synth``, which must do; returns the folder."""

    def run(*options, name='out'):
        done, out = synth(*options, name=name)
        assert (done.code, done.err) == (0, '')
        return out

    return run


@pytest.fixture
def plain_photo(tmp_path):
    """Return a grey photo without any texture: all that is seen on it was laid there."""
    path = tmp_path / 'plain.png'
    cv2.imwrite(str(path), np.full(SIZE, GREY, np.uint8))
    return path


# -- what is written -----------------------------------------------------------------------------


def test_folder_holds_reference_frames_and_truth(synth):
    done, out = synth('--frames', 2)
    assert done.code == 0
    assert done.out == f'{out}: 2 live frames with truth\n'
    kinds = ('live', 'truth', 'objects', 'layers')
    images = {f'{kind}_{number}.png' for kind in kinds for number in ('000', '001')}
    assert {path.name for path in out.iterdir()} == images | {'reference.png', 'truth.json'}
    for name in ('reference', 'live_000', 'live_001'):
        assert read(out / f'{name}.png').shape == (*SIZE, 3)


def test_labels_are_those_of_cdnet(made):
    out = made()
    label, objects = read(out / 'truth_000.png'), read(out / 'objects_000.png')
    assert label.shape == objects.shape == SIZE
    # an offset of 20 px brings the outside into view, two objects and their rims the others
    assert np.unique(label).tolist() == [0, 85, 170, 255]
    np.testing.assert_array_equal(np.unique(objects[label == 255]), [1, 2])
    assert not objects[(label == 0) | (label == 170)].any()


def test_truth_says_how_the_frame_was_taken(made):
    out = made('--seed', 4, '--exposure-rows', 30, '--frames', 1, '--rate', 4, '--focal-px', 300)
    about = truth_in(out)
    (entry,) = about['frames']
    assert about['focal_px'] == 300
    assert (about['plan']['seed'], about['plan']['blur_px']) == (4, 3.0)
    assert about['nuisances'] == about['plan']['nuisances']
    assert (entry['frame'], entry['time_s'], entry['exposure_rows']) == (0, 0.25, 30)
    assert np.shape(entry['centroids']) == (SIZE[0], 6)
    path = entry['path']
    assert path['first_row'] == -15
    assert np.shape(path['poses']) == (SIZE[0] + 30, 6)
    middle = np.mean(path['poses'][15:46], axis=0)  # row 15 is lit from row 0 to 30
    np.testing.assert_allclose(middle, entry['centroids'][15], atol=0.05)  # whole rows only
    assert len(entry['depths']) == int(read(out / 'layers_000.png').max())


def test_objects_are_boxes_around_their_pixels(made):
    out = made()
    numbers = read(out / 'objects_000.png')
    boxes = truth_in(out)['frames'][0]['objects']
    assert list(boxes) == ['object 1', 'object 2']
    for number, box in enumerate(boxes.values(), 1):
        assert box == list(cv2.boundingRect((numbers == number).astype(np.uint8)))


def test_equal_seeds_give_equal_bytes_and_others_do_not(made):
    one, same, other = (
        bytes_in(made('--seed', seed, name=name)) for name, seed in (('a', 7), ('b', 7), ('c', 8))
    )
    assert one == same
    assert all(one[name] != other[name] for name in ('reference.png', 'live_000.png', 'truth.json'))


def test_objects_appear_one_after_the_other(made):
    found = [len(entry['objects']) for entry in truth_in(made('--frames', 5))['frames']]
    assert found[0] == 0
    assert found == sorted(found)
    assert found[-1] == 2


# -- options -------------------------------------------------------------------------------------


def test_exposure_in_seconds_is_the_one_in_rows(made):
    rows = made('--exposure-rows', 40, name='rows')
    seconds = made('--exposure-ms', 2, '--line-delay-us', 50, name='seconds')
    assert truth_in(seconds)['frames'][0]['exposure_rows'] == pytest.approx(40)
    assert pictures_in(seconds) == pictures_in(rows)


def test_bottom_up_reads_the_same_motion_from_the_last_row_on(made):
    down = centroids_in(made(name='down'))
    up = centroids_in(made('--readout', 'bottom_up', name='up'))
    assert np.abs(np.diff(down[:, 0])).max() > 0.01  # px: it does move
    np.testing.assert_array_equal(up, down[::-1])


def test_global_shutter_has_one_pose_for_all_rows(made):
    poses = centroids_in(made('--readout', 'global'))
    np.testing.assert_array_equal(poses, np.broadcast_to(poses[0], poses.shape))


def test_each_motion_moves_the_rows_in_its_own_way(made):
    found = {
        motion: centroids_in(made('--motion', motion, '--objects', 0, name=motion))
        for motion in ('hover', *MOTIONS)
    }
    speeds = {motion: np.diff(poses[:, :2], axis=0) for motion, poses in found.items()}
    # px a row; `constant` adds only the drone's drift of 20 px around 9 s to a straight line
    steady = {motion: np.ptp(speed, axis=0).max() < 1e-3 for motion, speed in speeds.items()}
    assert steady == {motion: motion == 'constant' for motion in found}
    assert len({poses.tobytes() for poses in found.values()}) == len(found)


def test_sharp_frames_have_no_blur(made):
    out = made('--exposure-rows', 0)
    assert truth_in(out)['frames'][0]['exposure_rows'] == 0
    assert truth_in(out)['plan']['blur_px'] == 0


def test_nuisances_are_as_given(made):
    given = {'gain': 1.5, 'noise_electrons': 500.0, 'mosaic': True, 'jpeg_quality': 70}
    options = [f'--nuisance={name}={value:g}' for name, value in given.items()]
    found = truth_in(made('--ideal', *options))['nuisances']
    assert {name: found[name] for name in given} == given
    assert (found['vignetting'], found['read_noise']) == (0.0, 0.0)


def test_ideal_camera_adds_nothing(made, plain_photo):
    out = made('--ideal', '--background', plain_photo, '--objects', 0)
    np.testing.assert_array_equal(read(out / 'live_000.png'), np.full(SIZE, GREY, np.uint8))


def test_background_is_the_reference_unaltered(made, tmp_path, texture_of):
    photo = np.dstack([texture_of(250, 330, seed) for seed in (1, 2, 3)])
    cv2.imwrite(str(tmp_path / 'photo.png'), photo)
    out = made('--background', tmp_path / 'photo.png')
    np.testing.assert_array_equal(read(out / 'reference.png'), photo)
    live, label = read(out / 'live_000.png'), read(out / 'truth_000.png')
    assert (live.shape, label.shape) == (photo.shape, photo.shape[:2])


def test_what_vanished_is_in_the_reference_and_not_in_the_live_frame(made, plain_photo):
    options = ('--ideal', '--background', plain_photo, '--objects', 0, '--vanished', 1)
    out = made(*options)
    reference = read(out / 'reference.png').astype(int)
    assert np.abs(reference - GREY).max() > 18  # grey levels: it stands out
    np.testing.assert_array_equal(read(out / 'live_000.png'), np.full(SIZE, GREY, np.uint8))
    assert np.count_nonzero(read(out / 'truth_000.png') == 255) > 100  # px
    assert list(truth_in(out)['frames'][0]['objects']) == ['object 1']


def test_what_appears_is_in_the_live_frame_and_not_in_the_reference(made, plain_photo):
    out = made('--ideal', '--background', plain_photo, '--objects', 1)
    np.testing.assert_array_equal(read(out / 'reference.png'), np.full(SIZE, GREY, np.uint8))
    difference = np.abs(read(out / 'live_000.png').astype(int) - GREY)
    label = read(out / 'truth_000.png')
    assert difference[label == 255].mean() > 9  # grey levels; blurred, half of 18 at least
    # what covers less than RIM_COVER of the exposure counts as unchanged; 1: rounding
    assert difference[label == 0].max() <= RIM_COVER * difference.max() + 1


# -- suites --------------------------------------------------------------------------------------


def test_suite_is_written_as_folders(rsmb, tmp_path):
    done = rsmb('synth', '-o', tmp_path / 'out', '--suite', 'quick', '--first', 2)
    assert (done.code, done.out) == (0, f'{tmp_path / "out"}: 2 cases of quick with truth\n')
    assert sorted(path.name for path in (tmp_path / 'out').iterdir()) == ['00', '01']
    for case in SUITES['quick'].cases(Wish(first=2)):
        folder = tmp_path / 'out' / case.name.rpartition('/')[2]
        same_pictures(folder, case)
        assert truth_in(folder)['focal_px'] == case.focal_px


def same_pictures(folder, case):
    for name, image in {
        'reference': case.reference,
        'live_000': case.live,
        'truth_000': case.label,
        'objects_000': case.objects,
        'layers_000': case.motion.layers,
    }.items():
        np.testing.assert_array_equal(read(folder / f'{name}.png'), image)


def test_groups_of_a_suite_are_in_the_names_of_its_folders(rsmb, tmp_path):
    options = ('--suite', 'authors', '--first', 1, '--size', '320x240')
    assert rsmb('synth', '-o', tmp_path / 'out', *options).code == 0
    assert [path.name for path in (tmp_path / 'out').iterdir()] == ['motion 2D uniform 00']


# -- bags ----------------------------------------------------------------------------------------


def test_bag_holds_frames_and_truth(synth):
    done, out = synth('--frames', 2, '--rate', 4, '--objects', 1, name='out.mcap')
    assert done.code == 0
    with Bag(out) as bag:
        reference = bag.guess_reference()
        live = bag.guess_live(reference.name)
        (image,) = (frame.image for frame in bag.frames(reference.name))
        frames = list(bag.frames(live.name))
        labels = [frame.image for frame in bag.frames('/truth/change_mask')]
        scenes = [json.loads(m.data) for _, _, m in bag.messages('/truth/scene')]
        assert bag.focal_px() > 0
    assert image.shape == (*SIZE, 3)
    assert [frame.image.shape for frame in frames] == [(*SIZE, 3)] * 2
    assert frames[1].stamp_ns - frames[0].stamp_ns == 250_000_000
    assert [set(np.unique(label)) <= {0, 85, 170, 255} for label in labels] == [True, True]
    assert [np.shape(scene['centroids']) for scene in scenes] == [(SIZE[0], 6)] * 2
    for label, scene in zip(labels, scenes, strict=True):
        assert (label == 255).any() == bool(scene['objects'])


def test_equal_seeds_give_equal_bags(made):
    one, same = (made(name=name).read_bytes() for name in ('a.mcap', 'b.mcap'))
    assert one == same


def test_quality_of_a_bag_is_that_of_the_nuisance(made):
    sizes = [
        made('--nuisance', f'jpeg_quality={quality}', name=f'{quality}.mcap').stat().st_size
        for quality in (30, 95)
    ]
    assert sizes[0] < 0.5 * sizes[1]


# -- bad usage -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        ('--exposure-rows 9 --exposure-ms 1 --line-delay-us 50', '--exposure-rows excludes'),
        ('--exposure-rows 9 --line-delay-us 50', '--exposure-rows excludes'),
        ('--exposure-ms 1', '--exposure-ms and --line-delay-us need each other'),
        ('--line-delay-us 50', '--exposure-ms and --line-delay-us need each other'),
        ('--nuisance fog=1', "--nuisance 'fog=1' must be NAME=VALUE, NAME one of gain, bias"),
        ('--nuisance gain', "--nuisance 'gain' must be NAME=VALUE"),
        ('--nuisance gain=30', "--nuisance gain: '30' must be a number from 0.05 to 20.0"),
        ('--nuisance gain=much', "--nuisance gain: 'much' must be a number"),
        ('--nuisance bias=nan', "--nuisance bias: 'nan' must be a number"),
        ('--nuisance jpeg_quality=90.5', "--nuisance jpeg_quality: '90.5' must be a number"),
        ('--nuisance mosaic=0.5', "--nuisance mosaic: '0.5' must be a number from 0 to 1"),
        ('--nuisance distortion=0.01 --background p.png', 'bends the reference too'),
        ('--suite quick -o bag.mcap', '--suite quick writes folders, not the bag bag.mcap'),
        ('--suite slow', "invalid choice: 'slow'"),
        ('--motion fast', "invalid choice: 'fast'"),
        ('--readout sideways', "invalid choice: 'sideways'"),
        ('--size 64x48', "'64x48' must be COLSxROWS, 320x240 to 7680x4320"),
        ('--frames 0', "'0' must be a number from 1 to 100000"),
        ('--texture 1.1', "'1.1' must be a number from 0 to 1"),
    ],
)
def test_wrong_usage_is_told_and_nothing_is_written(synth, tmp_path, monkeypatch, options, message):
    monkeypatch.chdir(tmp_path)
    done, _ = synth(*options.split())
    assert done.code == 2
    assert message in done.err
    assert list(tmp_path.iterdir()) == []


def test_output_is_needed(rsmb):
    done = rsmb('synth')
    assert done.code == 2
    assert '-o/--output' in done.err


def test_missing_background_is_named(synth, tmp_path):
    done, out = synth('--background', tmp_path / 'gone.png')
    assert (done.code, out.exists()) == (1, False)
    assert 'gone.png: cannot be read: No such file or directory' in done.err


def test_output_that_is_a_file_is_named(synth, tmp_path):
    (tmp_path / 'out').write_text('mine')
    done, out = synth()
    assert done.code == 1
    assert f'{out}: cannot be made a folder' in done.err
    assert out.read_text() == 'mine'


def test_suite_on_photos_says_what_it_needs(synth, monkeypatch):
    monkeypatch.delenv('RSMB_DATA', raising=False)
    done, out = synth('--suite', 'photos')
    assert (done.code, out.exists()) == (1, False)
    assert 'give the folder that holds them with --data or RSMB_DATA' in done.err


def test_frames_of_an_older_run_are_removed_and_nothing_else(made, tmp_path):
    out = made('--frames', 3, name='again')
    (out / 'live_own.png').write_bytes(b'mine')
    again = made('--frames', 1, name='again')
    assert again == out
    names = sorted(path.name for path in out.glob('*_*.png'))
    kinds = ('layers_000.png', 'live_000.png', 'live_own.png', 'objects_000.png', 'truth_000.png')
    assert names == sorted(kinds)
