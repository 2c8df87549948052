"""Bag, video and folder of the same frames give the same masks."""

import cv2
import numpy as np
import pytest
from small_flight import START_NS, STEP_NS, equal_masks

from rsmb_ros.bags.opening import open_recording
from rsmb_ros.bags.video import Video
from rsmb_ros.core.errors import BagError, ConfigError
from rsmb_ros.replay.job import ReplayJob
from rsmb_ros.replay.selection import Selection


@pytest.fixture
def of_bag(replayed, flight_bag):
    """Masks of the bag against its first live frame."""
    return replayed(flight_bag, reference='@0')[1]


def test_folder_of_images_gives_the_masks_of_the_bag(replayed, image_folder, of_bag):
    summary, masks = replayed(image_folder, 'folder', reference='@0', rate=4.0)
    assert (summary.frames, summary.topic) == (6, '/image')
    assert list(masks) == [n * STEP_NS for n in range(6)]
    assert equal_masks(masks, of_bag)
    assert not masks[0].any()
    assert masks[5 * STEP_NS].any()


def test_video_gives_what_its_frames_give(replayed, video_file, tmp_path):
    folder = tmp_path / 'frames'
    folder.mkdir()
    with open_recording(video_file) as video:
        for frame in video.frames('/image'):
            cv2.imwrite(str(folder / f'{frame.index}.png'), frame.image)
    _, wanted = replayed(folder, 'folder', reference='@0')
    summary, masks = replayed(video_file, 'video', reference='@0')
    assert (summary.frames, summary.skipped) == (6, 0)
    assert list(masks) == [n * 125_000_000 for n in range(6)]  # 8 Hz
    assert equal_masks(masks, wanted)


def test_rate_of_a_video_can_be_given(video_file):
    with open_recording(video_file, rate=2.0) as video:
        assert [f.stamp_ns for f in video.frames('/image')][:3] == [0, 500_000_000, 1_000_000_000]


def test_every_recording_knows_about_when_it_is(flight_bag, video_file, image_folder):
    for path, first_ns, length_ns in (
        (flight_bag, START_NS, 6 * STEP_NS),
        (video_file, 0, 625_000_000),
        (image_folder, 0, 500_000_000),
    ):
        with open_recording(path) as recording:
            assert recording.span_ns() == (first_ns, first_ns + length_ns)


def test_rate_of_a_bag_is_refused(flight_bag):
    with pytest.raises(ConfigError, match=r'--rate 2: .* is a bag, whose frames have stamps'):
        open_recording(flight_bag, 2.0)


def test_names_are_ordered_by_their_numbers(image_folder, photos):
    with open_recording(image_folder) as folder:
        frames = list(folder.frames('/image'))
    assert [frame.stamp_ns for frame in frames] == [n * 100_000_000 for n in range(6)]
    for frame, photo in zip(frames, photos[1:], strict=True):
        np.testing.assert_array_equal(frame.image, photo)


def test_images_of_several_sizes_and_broken_ones(replayed, photos, tmp_path, caplog):
    cv2.imwrite(str(tmp_path / '1.png'), photos[0])
    cv2.imwrite(str(tmp_path / '2.jpg'), photos[1][:-6, :-8])
    (tmp_path / '3.png').write_bytes((tmp_path / '1.png').read_bytes()[:200])
    cv2.imwrite(str(tmp_path / '4.png'), photos[2])
    summary, masks = replayed(tmp_path, reference='@0')
    assert (summary.frames, summary.skipped) == (3, 1)
    assert [mask.shape for mask in masks.values()] == [(96, 128), (90, 120), (96, 128)]
    (told,) = (record.getMessage() for record in caplog.records)
    assert f'image 2 of {tmp_path} skipped: {tmp_path / "3.png"}: not an image' in told


def test_video_that_is_cut_off_counts_what_is_missing(video_file, tmp_path, caplog):
    path = tmp_path / 'cut.avi'
    data = video_file.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    with open_recording(path) as video:
        frames = list(video.frames('/image'))
        if video.topics[0].count == 6:  # as the header announces
            assert video.skipped['/image'] == 6 - len(frames) > 0
            assert '6 frames are announced, only' in caplog.text
    assert 0 < len(frames) < 6


def test_what_is_no_recording_says_what_is(tmp_path):
    with pytest.raises(BagError, match=r'gone: no such file or folder; a recording is a rosbag2'):
        open_recording(tmp_path / 'gone')
    with pytest.raises(BagError, match=r'neither metadata\.yaml, .* nor images \(\.png, \.jpg'):
        open_recording(tmp_path)
    (tmp_path / 'film.mp4').write_text('no film')
    with pytest.raises(BagError, match=r'film\.mp4: OpenCV cannot read it as a video; convert'):
        Video(tmp_path / 'film.mp4')


def test_part_of_a_bag(replayed, flight_bag, of_bag):
    job = Selection(start_ns=STEP_NS, stride=2)
    summary, masks = replayed(flight_bag, 'part', reference='@0', selection=job)
    assert summary.frames == 3
    assert list(masks) == [START_NS + n * STEP_NS for n in (2, 4, 6)]
    assert all(np.array_equal(mask, of_bag[stamp]) for stamp, mask in masks.items())


def test_part_without_frames_is_wrong_usage_and_writes_nothing(replayed, flight_bag, tmp_path):
    with pytest.raises(ConfigError, match=r'--start 9 s: no frame of /image'):
        replayed(flight_bag, selection=Selection(start_ns=9 * 10**9))
    assert not list(tmp_path.iterdir())


def test_output_over_the_input_is_refused(flight_bag):
    with pytest.raises(ConfigError, match='is the bag to be read'):
        ReplayJob(flight_bag, flight_bag)
