"""Changes on the map: only where everything that is needed was told."""

import json
import math
import re
from types import SimpleNamespace

import numpy as np
import pytest
from containers import in_container
from small_flight import COLS, ROWS, START_NS, STEP_NS

from rsmb_ros.bags.check import check
from rsmb_ros.bags.recording import NAV_SAT_FIX
from rsmb_ros.bags.typestore import new, serialised
from rsmb_ros.bags.writing import BagWriter
from rsmb_ros.cli.main import main
from rsmb_ros.core import Config
from rsmb_ros.core.errors import BagError, ConfigError
from rsmb_ros.core.types import Region
from rsmb_ros.replay.fixes import Track, fix_from_msg
from rsmb_ros.replay.geojson_sink import COURSE, Flight, GeoJsonSink, GeoOptions
from rsmb_ros.replay.ground import metres_per_degree
from rsmb_ros.replay.job import ReplayJob, replay

FOCAL = Config().replaced({'camera.focal_px': 200.0})
LATITUDE, LONGITUDE = 47.0, 8.0


def fix_message(factory, stamp_ns, north=0.0, altitude=480.0):
    return new(
        'sensor_msgs/msg/NavSatFix',
        header=factory.header(stamp_ns, 'gps'),
        status=new('sensor_msgs/msg/NavSatStatus', status=0, service=1),
        latitude=LATITUDE + north / metres_per_degree(LATITUDE)[0],
        longitude=LONGITUDE,
        altitude=altitude,
        position_covariance=np.zeros(9),
        position_covariance_type=0,
    )


def track_of(messages):
    return Track(filter(None, map(fix_from_msg, messages)))


@pytest.fixture(scope='module')
def make_bag(photos, factory, tmp_path_factory):
    """
    Return a maker of flights with fixes at 10 Hz on some topics; it flies north.

    `cut` counts those from the start whose bytes end in the middle.
    """

    def make(topics=('/fix',), speed=4.0, camera_info=True, width=COLS, distortion=0.0, cut=()):
        path = tmp_path_factory.mktemp('fixes') / 'flight.mcap'
        with BagWriter(path) as bag:
            for n in range(-10, 30):
                time_ns = START_NS + n * 10**8
                for topic in topics:
                    message = fix_message(factory, time_ns, speed * n / 10)
                    data = serialised(message)
                    if n + 10 in cut:
                        data = data[:30]
                    bag.write_cdr(topic, NAV_SAT_FIX, data, time_ns)
            for n, photo in enumerate(photos):
                time_ns = START_NS + n * STEP_NS
                header = factory.header(time_ns, 'cam')
                if camera_info:
                    info = factory.camera_info(header, (ROWS, width), 200.0)
                    info.d[0] = distortion
                    bag.write('/camera_info', info, time_ns)
                topic = '/image' if n else '/reference/image'
                bag.write(topic, factory.image(header, photo), time_ns)
        return path

    return make


def features(path):
    return json.loads(path.read_text())['features']


@pytest.fixture
def take(factory, tmp_path):
    """Return a function that writes one change of a 201 x 101 px frame at 10.05 s."""

    def run(region=None, track=None, **options):
        options = {'heading': 0.0, 'height': 40.0, **options}
        if track is None:
            track = track_of(fix_message(factory, n * 10**8, n / 10) for n in range(90, 112))
        sink = GeoJsonSink(GeoOptions(tmp_path / 'out.json', **options), Flight(track, 200.0))
        region = region or Region(100, 30, 11, 21, area=150, kind='change', score=0.75)
        frame = SimpleNamespace(index=7, stamp_ns=10_050_000_000, image=np.zeros((101, 201)))
        result = SimpleNamespace(regions=(region,), changes=(region,))
        sink.take(frame, None, result)
        sink.close()
        (feature,) = features(tmp_path / 'out.json')
        return feature

    return run


def metres(place, north):
    """Return east and north [m] of a camera `north` metres north of the origin."""
    along, across = metres_per_degree(LATITUDE)
    return (place[0] - LONGITUDE) * across, (place[1] - LATITUDE) * along - north


def test_box_lies_where_the_camera_saw_it(take):
    feature = take()
    assert feature['geometry']['type'] == 'Polygon'
    (ring,) = feature['geometry']['coordinates']
    assert ring[0] == ring[-1]
    assert len(ring) == 5
    # columns 100 to 110, rows 30 to 50 of 201 x 101 px, 0.2 m each; edges half a pixel outside
    wanted = [(-0.1, -0.1), (2.1, -0.1), (2.1, 4.1), (-0.1, 4.1)]
    # 10.05 s, flown at 1 m/s; 8 digits of a degree are 1 mm
    np.testing.assert_allclose([metres(place, 10.05) for place in ring[:4]], wanted, atol=2e-3)


def test_properties_tell_stamp_score_and_area(take):
    told = take()['properties']
    assert told['stamp_ns'] == '10050000000'
    assert (told['frame'], told['score'], told['kind']) == (7, 0.75, 'change')
    assert told['area_m2'] == pytest.approx(150 * 0.2**2)
    assert (told['height_m'], told['heading_deg']) == (40.0, 0.0)


def test_height_is_that_of_the_fix_above_the_ground(take):
    told = take(height=None, ground_altitude=430.0)['properties']
    assert told['height_m'] == 50.0


def test_heading_is_the_course_if_asked_for(take):
    assert take(heading=COURSE)['properties']['heading_deg'] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ('options', 'reason'),
    [
        ({'height': None, 'ground_altitude': 500.0}, r'height -20\.0 m: altitude of the fix 480'),
        ({'track': Track([])}, 'no fix before and after the frame'),
    ],
)
def test_change_without_a_place_says_why(take, options, reason, caplog):
    feature = take(**options)
    assert feature['geometry'] is None
    assert feature['properties']['area_m2'] is None
    (logged,) = caplog.records
    for text in (feature['properties']['no_place'], logged.getMessage()):
        assert re.search(reason, text)


def test_altitude_that_is_not_told_gives_no_place(take, factory):
    for altitude in (math.nan, math.inf):
        fixes = [fix_message(factory, n * 10**8, altitude=altitude) for n in range(90, 112)]
        track = track_of(fixes)
        assert take(track=track, height=None, ground_altitude=430.0)['geometry'] is None
    assert take(track=track)['geometry'] is not None  # a given height needs no altitude


# -- a replay --------------------------------------------------------------------------------------


def test_changes_of_a_flight_are_on_the_map(make_bag, tmp_path):
    out = tmp_path / 'changes.geojson'
    options = GeoOptions(out, heading=COURSE, height=50.0)
    summary = replay(ReplayJob(make_bag(), tmp_path / 'o.mcap', geojson=options))
    found = features(out)
    assert len(found) == summary.changes > 0
    assert 'the camera looks straight down' in json.loads(out.read_text())['assumptions']
    for feature in found:
        time_s = (int(feature['properties']['stamp_ns']) - START_NS) * 1e-9
        (ring,) = feature['geometry']['coordinates']
        reach = 0.25 * max(ROWS, COLS)  # m, 0.25 m/px
        assert np.abs([metres(place, 4 * time_s) for place in ring]).max() < reach


@pytest.mark.parametrize('kind', ['bag', 'folder db3'])
def test_map_is_that_of_the_bag_in_every_container(make_bag, tmp_path, kind):
    bag = make_bag()
    for name, source in (('one', bag), ('two', in_container(bag, kind, tmp_path))):
        options = GeoOptions(tmp_path / f'{name}.geojson', heading=COURSE, height=50.0)
        replay(ReplayJob(source, tmp_path / f'{name}.mcap', geojson=options))
    assert (tmp_path / 'one.geojson').read_bytes() == (tmp_path / 'two.geojson').read_bytes()


def test_focal_length_of_other_images_gives_no_place(make_bag, tmp_path, caplog):
    bag = make_bag(width=2 * COLS)
    options = GeoOptions(tmp_path / 'o.geojson', heading=0.0, height=50.0)
    replay(ReplayJob(bag, tmp_path / 'o.mcap', geojson=options))
    assert {str(feature['geometry']) for feature in features(options.path)} == {'None'}
    assert f'camera_info is of images {2 * COLS} px wide, the frame has {COLS} px' in caplog.text
    replay(ReplayJob(bag, tmp_path / 'o.mcap', geojson=options, config=FOCAL))
    assert all(feature['geometry'] for feature in features(options.path))


def test_lens_that_distorts_is_told(make_bag, tmp_path, caplog):
    options = GeoOptions(tmp_path / 'o.geojson', heading=0.0, height=50.0)
    replay(ReplayJob(make_bag(distortion=-0.2), tmp_path / 'o.mcap', geojson=options))
    assert 'camera_info tells of a lens that distorts: places are off' in caplog.text


def test_file_is_whole_after_every_frame(tmp_path):
    out, counts = tmp_path / 'o.geojson', []
    sink = GeoJsonSink(GeoOptions(out, heading=0.0, height=50.0), Flight(Track([]), 200.0))
    region = Region(100, 30, 11, 21, area=150, kind='change', score=0.75)
    for index, changes in enumerate([(region,), (), (region, region), (region,)]):
        counts.append(len(features(out)))
        frame = SimpleNamespace(index=index, stamp_ns=index, image=np.zeros((101, 201)))
        sink.take(frame, None, SimpleNamespace(changes=changes))
    sink.close()
    assert [*counts, len(features(out))] == [0, 1, 1, 3, 4]


def test_map_is_equal_after_going_on(make_bag, tmp_path):
    bag = make_bag()
    for name, resume in (('one', False), ('two', True)):
        options = GeoOptions(tmp_path / f'{name}.geojson', heading=0.0, height=50.0)
        replay(ReplayJob(bag, tmp_path / 'o.mcap', geojson=options, keep_input=True,
                         resume=resume))  # fmt: skip
    assert (tmp_path / 'one.geojson').read_bytes() == (tmp_path / 'two.geojson').read_bytes()


@pytest.mark.parametrize(
    ('cut', 'told'),
    [
        ([12, 15, 16], '3 messages of /fix skipped, the first is message 12: no sensor_msgs'),
        ([3], '/fix skipped: message 3: no sensor_msgs/msg/NavSatFix'),
    ],
)
@pytest.mark.parametrize('kind', [None, 'folder db3'])
def test_damaged_fixes_are_skipped_and_told_once(make_bag, tmp_path, caplog, cut, told, kind):
    damaged = make_bag(cut=cut)
    damaged = in_container(damaged, kind, tmp_path) if kind else damaged
    for name, source in (('one', make_bag()), ('two', damaged)):
        options = GeoOptions(tmp_path / f'{name}.geojson', heading=COURSE, height=50.0)
        summary = replay(ReplayJob(source, tmp_path / f'{name}.mcap', geojson=options))
        assert summary.lost == (len(cut) if name == 'two' else 0)
    assert f'at least {len(cut)} messages are lost' in summary.line()
    (logged,) = [record.getMessage() for record in caplog.records]
    assert logged.startswith(f'{source}: {told}')
    # the drone flies straight: the fixes around those that are missing say the same
    one, two = (features(tmp_path / f'{name}.geojson') for name in ('one', 'two'))
    assert [f['properties'] for f in two] == [f['properties'] for f in one]
    for pair in zip(one, two, strict=True):
        rings = [feature['geometry']['coordinates'][0] for feature in pair]
        np.testing.assert_allclose(*rings, atol=2e-8)  # degrees; written with 8 digits


def test_bag_of_damaged_fixes_only_is_refused(make_bag, tmp_path, caplog):
    options = GeoOptions(tmp_path / 'o.geojson', heading=0.0, height=50.0)
    with pytest.raises(BagError, match='no message of /fix has a fix'):
        replay(ReplayJob(make_bag(cut=range(40)), tmp_path / 'o.mcap', geojson=options))
    assert '40 messages of /fix skipped, the first is message 0' in caplog.text


def test_check_finds_damaged_fixes(make_bag):
    found = check(make_bag(cut=[3, 8]))
    assert found.damaged
    assert f'/fix ({NAV_SAT_FIX}): 38 of 40 messages whole, 2 cannot be read' in found.lines


# -- refusals --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('options', 'missing'),
    [
        (['--height', '50'], 'needs --heading'),
        (['--heading', '0'], 'needs --height, in metres above the ground, or --ground-altitude'),
        (['--heading', '0', '--height', '5', '--ground-altitude', '5'], 'give one'),
        (['--heading', 'north', '--height', '5'], 'degrees from -360 to 360, or course'),
        (['--heading', '0', '--height', '0'], 'metres, 0.1 to 100000'),
    ],
)
def test_missing_value_is_named(make_bag, tmp_path, capsys, options, missing):
    out = tmp_path / 'o.mcap'
    command = ['replay', make_bag(), '-o', out, '--geojson', tmp_path / 'o.geojson', *options]
    try:
        code = main([str(word) for word in command])
    except SystemExit as error:
        code = error.code
    assert code == 2
    assert missing in ' '.join(capsys.readouterr().err.split())
    assert list(tmp_path.iterdir()) == []


def test_value_without_a_map_is_refused(make_bag, tmp_path, capsys):
    code = main(['replay', str(make_bag()), '-o', str(tmp_path / 'o.mcap'), '--heading', '0'])
    assert code == 2
    assert '--heading is for --geojson, which is missing' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('bag', 'config', 'error', 'told'),
    [
        ({'camera_info': False}, Config(), ConfigError, 'needs the focal length'),
        ({'topics': ()}, FOCAL, BagError, 'no topic of sensor_msgs/msg/NavSatFix'),
        ({'topics': ('/a', '/b')}, FOCAL, BagError, r'several topics \(/a, /b\)'),
    ],
)
def test_bag_that_does_not_tell_is_refused(make_bag, tmp_path, bag, config, error, told):
    options = GeoOptions(tmp_path / 'o.geojson', heading=0.0, height=50.0)
    with pytest.raises(error, match=told):
        replay(ReplayJob(make_bag(**bag), tmp_path / 'o.mcap', config=config, geojson=options))
    assert list(tmp_path.iterdir()) == []


def test_topic_of_fixes_may_be_named(make_bag, tmp_path):
    bag = make_bag(topics=('/a', '/b'))
    for topic, problem in (('/b', ''), ('/image', '--fix /image is sensor_msgs/msg/Image')):
        options = GeoOptions(tmp_path / 'o.geojson', heading=0.0, height=50.0, fix=topic)
        job = ReplayJob(bag, tmp_path / 'o.mcap', geojson=options)
        if problem:
            with pytest.raises(BagError, match=problem):
                replay(job)
        else:
            assert replay(job).changes == len(features(tmp_path / 'o.geojson'))


def test_images_are_no_map(image_folder, tmp_path):
    options = GeoOptions(tmp_path / 'o.geojson', heading=0.0, height=50.0)
    with pytest.raises(ConfigError, match='--geojson is for bags'):
        replay(ReplayJob(image_folder, tmp_path / 'o.mcap', reference='@0', geojson=options))
