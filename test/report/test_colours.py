"""Text can be read on its ground, in light and in dark (WCAG 2.1, 1.4.3)."""

import re
from importlib.resources import files

import pytest

STYLE = files('rsmb_ros.report').joinpath('templates/base.css').read_text('utf-8')
LIGHT, DARK = (dict(re.findall(r'--([a-z_-]+): #([0-9a-f]{3,6});', part))
               for part in STYLE.split('@media (prefers-color-scheme: dark)')[:2])  # fmt: skip
PAIRS = [
    (text, ground) for text in ('ink', 'soft', 'alarm', 'link') for ground in ('paper', 'card')
]
PAIRS += [('alarm', 'alarm-ground'), ('warn', 'warn-ground'), ('warn', 'card'), ('static', 'card')]
PAIRS += [('card', 'ink'), ('t_x', 'card'), ('t_y', 'card'), ('r_z', 'card')]
LEAST = 4.5  # for text of normal size


def luminance(color):
    digits = color if len(color) == 6 else ''.join(2 * digit for digit in color)
    levels = [int(digits[n : n + 2], 16) / 255 for n in (0, 2, 4)]
    light = [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in levels]
    return 0.2126 * light[0] + 0.7152 * light[1] + 0.0722 * light[2]


@pytest.mark.parametrize('theme', [LIGHT, DARK], ids=['light', 'dark'])
@pytest.mark.parametrize(('text', 'ground'), PAIRS)
def test_text_stands_out(theme, text, ground):
    high, low = sorted((luminance(theme[text]), luminance(theme[ground])), reverse=True)
    assert (high + 0.05) / (low + 0.05) >= LEAST


def test_both_themes_name_the_same_colours():
    assert LIGHT.keys() == DARK.keys()
