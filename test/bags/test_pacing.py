"""When what is recorded is played: at its own time, or so many live frames a second."""

from rsmb_ros.bags.pacing import paced

STORED = [
    ('/reference', 1_000_000_000, b'r'),
    ('/info', 1_500_000_000, b'i0'),
    ('/image', 1_500_000_000, b'f0'),
    ('/image', 1_600_000_000, b'f1'),
    ('/info', 1_650_000_000, b'i2'),
    ('/image', 2_000_000_000, b'f2'),
]


def test_own_rate_keeps_the_times_and_what_is_of_one_moment_together():
    moments = list(paced(STORED))
    assert [round(moment.offset_s, 9) for moment in moments] == [0.0, 0.5, 0.6, 0.65, 1.0]
    assert moments[1].messages == [('/info', b'i0'), ('/image', b'f0')]


def test_given_rate_counts_live_frames_only():
    moments = list(paced(STORED, '/image', 10.0))
    assert [(m.offset_s, [data for _, data in m.messages]) for m in moments] == [
        (0.0, [b'r']),
        (0.0, [b'i0', b'f0']),
        (0.1, [b'f1']),
        (0.2, [b'i2']),
        (0.2, [b'f2']),
    ]


def test_nothing_recorded_is_nothing_to_play():
    assert not list(paced([]))
