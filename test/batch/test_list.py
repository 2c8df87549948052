"""Lists of recordings, in YAML and CSV."""

from pathlib import Path

import pytest

from rsmb_ros.batch.items import Item
from rsmb_ros.cli.batch_list import beside, read_list
from rsmb_ros.core import Config
from rsmb_ros.core.errors import ConfigError, FileProblem

COMMON = Item(Path(), '@0', '/cam', config=Config().replaced({'change.threshold_low': 1.5}))
HIGH = COMMON.config.replaced({'change.threshold_high': 8.0, 'photometric.vignetting': False})
YAML = """
- bag: day1/a.bag
- {bag: b.mcap, reference: clean.png, topic: /front, name: second,
   config: {change: {threshold_high: 8}, photometric.vignetting: false}}
"""
CSV = """\ufeffbag,reference,topic,name,change.threshold_high, photometric.vignetting
day1/a.bag,,,,,
b.mcap,clean.png,/front,second,8,false
"""


@pytest.fixture
def read(tmp_path):
    """Return a function that reads a list of that content."""
    (tmp_path / 'clean.png').touch()

    def make(text, name='list.yaml'):
        path = tmp_path / name
        path.write_text(text, 'utf-8')
        return read_list(path, COMMON)

    return make


@pytest.mark.parametrize(('text', 'name'), [(YAML, 'list.yaml'), (CSV, 'list.CSV')])
def test_entries_say_what_is_special(text, name, read, tmp_path):
    plain, special = read(text, name)
    assert plain == Item(tmp_path / 'day1/a.bag', '@0', '/cam', config=COMMON.config)
    reference = str(tmp_path / 'clean.png')
    assert special == Item(tmp_path / 'b.mcap', reference, '/front', 'second', HIGH)


@pytest.mark.parametrize(
    ('text', 'name', 'reason'),
    [
        ('bag: a', 'l.yaml', 'must hold a list, each entry like'),
        ('- a.bag', 'l.yaml', 'must hold a list'),
        ('[', 'l.yaml', 'not YAML'),
        ('- {bag: a}\n- {bags: b}', 'l.yaml', "recording 2: 'bags' is unknown; must be one of bag"),
        ('- {topic: a}', 'l.yaml', 'recording 1: bag is missing'),
        ('- {bag: 7}', 'l.yaml', 'recording 1: bag = 7 is a int, must be a text; quote it'),
        ('- {bag: a, config: 3}', 'l.yaml', 'config = 3 must hold parameters'),
        ('bag,change.min_area\na,9', 'l.csv', 'recording 1: change.min_area = 9.0 is not allowed'),
        ('bag,shutter.rows\na,9', 'l.csv', "parameter 'shutter.rows' is unknown"),
        ('bag,topic\na,b,c', 'l.csv', 'line 2 has another number of columns'),
    ],
)
def test_mistakes_are_told_with_their_place(text, name, reason, read):
    with pytest.raises(ConfigError, match=r'^--manifest .*l\.(yaml|csv): ') as caught:
        read(text, name)
    assert reason in str(caught.value)


def test_list_that_is_missing_is_told(tmp_path):
    with pytest.raises(FileProblem, match=r'--manifest .*none\.yaml: cannot be read: No such'):
        read_list(tmp_path / 'none.yaml', COMMON)


def test_files_of_references_lie_beside_the_list(tmp_path):
    (tmp_path / 'r.mcap').touch()
    assert beside(tmp_path, 'r.mcap:/image@0') == f'{tmp_path}/r.mcap:/image@0'
    assert beside(tmp_path, 'r.mcap@1.5') == f'{tmp_path}/r.mcap@1.5'
    for other in ('@0', '/image@0', '/reference/image', 'gone.png'):
        assert beside(tmp_path, other) == other
    assert beside(tmp_path, None) is None


def test_list_is_replayed(rsmb, write_bag, tmp_path):
    write_bag(tmp_path / 'in' / 'a.mcap', 1)
    (tmp_path / 'in' / 'list.yaml').write_text('- {bag: a.mcap, name: first}\n')
    code, _, err = rsmb(
        'batch', '--manifest', tmp_path / 'in' / 'list.yaml', '-o', tmp_path, '--max-frames', 1
    )
    assert (code, err) == (0, [])
    assert (tmp_path / 'first.mcap').is_file()
