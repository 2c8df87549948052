"""Numbers as people read them."""

import pytest

from rsmb_ros.report.words import numbers, percent


@pytest.mark.parametrize(
    ('share', 'text'),
    [
        (0, '0 %'),
        (0.0001, '0.1 %'),
        (0.114, '11 %'),
        (0.9999, '99.9 %'),
        (0.995, '99.5 %'),
        (1, '100 %'),
    ],
)
def test_a_little_is_never_nothing_and_nearly_all_never_all(share, text):
    assert percent(share) == text


def test_one_is_no_plural():
    assert (numbers(1, 'frame'), numbers(1234, 'frame')) == ('1 frame', '1,234 frames')
