"""The manifest is right at every moment."""

import pytest

from rsmb_ros.batch.manifest import DONE, Entry, Manifest
from rsmb_ros.batch.tasks import Counts
from rsmb_ros.batch.wishes import Wish
from rsmb_ros.core.errors import FileProblem

WISH = Wish('0.1.0', {'topic': '/a', 'change.min_area': 0.1}, 'ab', {'bytes': 3, 'digest': 'cd'})
ENTRY = Entry(
    *('a', '/in/a.bag', DONE, ('a.mcap', 'a.csv'), WISH),
    counts=Counts(5, 1, 0, 4, 2),
    seconds=1.25,
    warnings=('frame 3 skipped',),
)


def test_entries_come_back_as_they_were(tmp_path):
    Manifest(tmp_path).put(ENTRY)
    assert Manifest(tmp_path).get('a') == ENTRY
    assert Manifest(tmp_path).get('b') is None


def test_manifest_that_cannot_be_written_stays(tmp_path, monkeypatch):
    manifest = Manifest(tmp_path)
    manifest.put(ENTRY)
    before = manifest.path.read_bytes()

    def full(number):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr('os.fsync', full)
    with pytest.raises(FileProblem, match=r'manifest\.json: cannot be written: No space left'):
        manifest.put(Entry('b', '/in/b.bag', DONE, (), WISH))
    assert manifest.path.read_bytes() == before


@pytest.mark.parametrize(
    'text', ['', '[]', '{"format": 2, "bags": []}', '{"format": 1, "bags": [{}]}']
)
def test_file_that_is_no_manifest_is_not_replaced(text, tmp_path):
    (tmp_path / 'manifest.json').write_text(text)
    with pytest.raises(FileProblem, match=r'manifest\.json: is no manifest of rsmb batch: .*move'):
        Manifest(tmp_path)
