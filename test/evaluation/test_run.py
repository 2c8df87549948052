"""Methods on cases: ours as one of them, rivals that share a registration, true places."""

import numpy as np
import pytest

from rsmb_ros.core.config import Config
from rsmb_ros.core.errors import ConfigError
from rsmb_ros.core.motion import Grid
from rsmb_ros.core.shutter import ShutterTiming
from rsmb_ros.core.synthesis import Nuisances, Scene, live_frame
from rsmb_ros.core.synthesis.paths import SIX_DOF, still, swaying_by, wobble
from rsmb_ros.evaluation.case import Case
from rsmb_ros.evaluation.methods import NotRegistered
from rsmb_ros.evaluation.ours import Ours
from rsmb_ros.evaluation.rivals import RIVALS, Rival
from rsmb_ros.evaluation.run import KNOWN_METHODS, methods_of, run_case, settings_of
from rsmb_ros.evaluation.suites import SUITES, Wish
from rsmb_ros.evaluation.warping import places_of_homography, places_of_poses, registration_at


@pytest.fixture(scope='module')
def quick():
    """Return the first two cases of `quick`: flat and layered, both changed."""
    return list(SUITES['quick'].cases(Wish(first=2)))


class Fake:
    """A registrar that finds no motion at all, or nothing, and counts how often it is asked."""

    name = 'fake'

    def __init__(self, refusal=None):
        self.calls = 0
        self._refusal = refusal

    def register(self, reference, live, focal_px):
        self.calls += 1
        if self._refusal:
            raise NotRegistered(self._refusal)
        return registration_at(places_of_homography(np.eye(3), live.shape), reference)


def rival(name, registrar, changed=False):
    def decide(live, registration):
        return np.full(live.shape, changed)

    return Rival(name, 'for tests', registrar, decide)


# -- ours ----------------------------------------------------------------------------------------


@pytest.fixture(scope='module')
def ours(quick):
    """What ours makes of the layered case."""
    return run_case(quick[1], methods_of(['rsmb'], Config()))


def test_ours_registers_within_half_a_pixel(quick, ours):
    outcome, score = ours.outcomes['rsmb'], ours.scores['rsmb']
    assert (outcome.registered, outcome.reason) == (True, '')
    assert score.registration.epe_median < 0.5  # px
    assert score.registration.row_rmse < 0.5  # px
    error = outcome.registration.places - quick[1].motion.places
    where = (quick[1].motion.layers == 0) & (quick[1].label == 0)
    assert np.median(np.linalg.norm(error[where], axis=1)) < 0.5  # px


def test_ours_says_all_that_is_scored(quick, ours):
    outcome, case = ours.outcomes['rsmb'], quick[1]
    shape = case.live.shape[:2]
    registration = outcome.registration
    assert outcome.change.shape == outcome.valid.shape == registration.inside.shape == shape
    assert registration.registered.shape == shape
    assert outcome.change.dtype == outcome.valid.dtype == registration.inside.dtype == bool
    assert outcome.change.any()
    assert outcome.seconds > 0
    assert outcome.exposure_rows > 0
    # what is outside the reference in truth is so in the registration, but for its rim
    outside = case.label == 85
    assert (registration.inside == ~outside).mean() > 0.98


def test_ours_knows_when_nothing_fits(quick, texture_of):
    first, second = (texture_of(240, 320, seed) for seed in (1, 2))
    outcome = Ours(Config())(first, second, None)
    assert not outcome.registered
    assert outcome.reason
    assert outcome.registration is None
    assert not outcome.change.any()
    assert not outcome.valid.any()


def test_ours_takes_what_is_known_of_the_camera():
    with pytest.raises(ConfigError, match=r'camera\.gama'):
        Ours(Config(), {'camera.gama': 1.0})


def test_suite_tells_its_camera_unless_other_nuisances_are_wanted():
    authors = SUITES['authors']
    assert settings_of(authors, 'usual') == {'camera.gamma': 1.0}
    assert [dict(settings_of(authors, other)) for other in ('none', 'all')] == [{}, {}]


# -- methods -------------------------------------------------------------------------------------


def test_methods_come_in_the_order_of_their_names():
    names = ['orb-tuned', 'rsmb', 'ecc']
    assert [method.name for method in methods_of(names, Config())] == names
    assert [method.name for method in methods_of(KNOWN_METHODS, Config())] == list(KNOWN_METHODS)
    assert all(method.source for method in methods_of(KNOWN_METHODS, Config()))


def test_unknown_method_is_refused_with_the_known():
    with pytest.raises(ConfigError) as caught:
        methods_of(['ecc', 'surf'], Config())
    assert str(caught.value) == f"method 'surf' is not known: {', '.join(KNOWN_METHODS)}"


def test_rivals_with_one_registrar_register_once(quick):
    shared, own = Fake(), Fake()
    methods = [rival('a', shared), rival('a-tuned', shared, changed=True), rival('b', own)]
    found = run_case(quick[0], methods)
    assert (shared.calls, own.calls) == (1, 1)
    first, tuned, _ = found.outcomes.values()
    assert first.registration is tuned.registration
    assert (first.change.any(), tuned.change.all()) == (False, True)
    assert tuned.seconds > 0


def test_every_case_is_registered_anew(quick):
    registrar = Fake()
    for case in quick:
        run_case(case, [rival('a', registrar), rival('b', registrar)])
    assert registrar.calls == len(quick)


def test_refusal_reaches_all_rivals_of_a_registrar(quick):
    registrar = Fake('no texture')
    found = run_case(quick[0], [rival('a', registrar), rival('b', registrar)])
    assert registrar.calls == 1
    for score in found.scores.values():
        assert (score.registered, score.reason, score.pixels.f) == (False, 'no texture', 0.0)


def test_default_and_tuned_twin_agree_with_being_called_alone(quick):
    case = quick[0]
    methods = methods_of(['ecc', 'ecc-tuned'], Config())
    found = run_case(case, methods)
    for method in methods:
        alone = RIVALS[method.name](case.reference, case.live, case.focal_px)
        np.testing.assert_array_equal(found.outcomes[method.name].change, alone.change)


def test_scores_carry_the_names_of_case_and_method(quick):
    found = run_case(quick[0], [rival('a', Fake())])
    score = found.scores['a']
    assert (score.case, score.suite, score.method) == ('quick/00', 'quick', 'a')


def test_case_of_real_motion_is_scored_on_pixels_only(texture_of):
    image, nothing = texture_of(60, 80, 3), np.zeros((60, 80), np.uint8)
    score = run_case(Case('real/0', image, image, nothing, nothing), [rival('a', Fake())]).scores
    assert score['a'].pixels.pwc == 0
    assert score['a'].registration.rmse == 0
    assert np.isnan(score['a'].registration.epe_median)


# -- true places ---------------------------------------------------------------------------------


@pytest.mark.parametrize('distortion', [0.0, 0.01])
@pytest.mark.parametrize('moving', [False, True], ids=['still', 'moving'])
def test_places_of_poses_are_those_of_the_truth(texture_of, moving, distortion):
    shape = (60, 80)
    scene = Scene(texture_of(120, 140, 4), 30)
    grid = Grid(shape, shape, 72.0)
    timing = ShutterTiming(0.0)  # sharp: the centroid pose is the only one of its row
    rng = np.random.default_rng(7)
    path = swaying_by(wobble('smooth', SIX_DOF, timing, shape[0], rng), 9.0, shape[0])
    _, truth = live_frame(
        scene, (), grid, path if moving else still, timing, Nuisances(distortion=distortion), rng
    )
    y, x = np.mgrid[: shape[0], : shape[1]]
    reach = np.linalg.norm(truth.places - np.dstack([x, y]), axis=2).max()
    assert (reach > 3) == moving  # px
    found = places_of_poses(truth.centroids, grid, distortion)
    np.testing.assert_allclose(found, truth.places, atol=1e-4)  # px: float32 of up to 100
