"""Which recordings a path stands for, and what their outputs are called."""

import pytest

from rsmb_ros.batch.items import Item, found_in, names_of, without_doubles
from rsmb_ros.core.errors import BagError, ConfigError


@pytest.fixture
def tree(tmp_path):
    """Return a function that makes empty files below a folder, and returns that."""

    def make(*names):
        for name in names:
            path = tmp_path / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.touch()
        return tmp_path

    return make


def found(folder, path=None, out='out'):
    return [str(one.relative_to(folder)) for one in found_in(path or folder, folder / out)]


def test_folder_is_searched_for_bags(tree):
    folder = tree(
        *('b.mcap', 'a.bag', 'c/x.db3', 'c/metadata.yaml', 'd/e/f.db3', 'd/e/g.db3'),
        *('out/b.mcap', '.hidden/y.mcap', '.z.mcap', 'film.mp4', 'notes.txt', 'h.mcap.part'),
    )
    assert found(folder) == ['a.bag', 'b.mcap', 'c', 'd/e/f.db3', 'd/e/g.db3']
    assert found(folder, folder / 'c') == ['c']
    assert found(folder, folder / 'film.mp4') == ['film.mp4']
    assert found(folder, folder / 'gone') == ['gone']  # told when its turn comes


def test_folder_of_images_is_a_recording_and_an_empty_one_is_told(tree):
    folder = tree('shots/1.png', 'empty/notes.txt')
    assert found(folder, folder / 'shots') == ['shots']
    with pytest.raises(BagError, match=r'empty: holds no recording: no \.mcap, \.db3, \.bag'):
        found(folder, folder / 'empty')


def named(folder, *names, known=None):
    return names_of([Item(folder / name) for name in names], known or {})


def test_equal_names_are_told_apart_by_folders_then_by_numbers(tree):
    folder = tree('a/x.mcap', 'b/x.mcap', 'y.mcap', 'z.bag', 'z.mcap', 'q/Y.db3', 'd.1/m.yaml')
    assert named(folder, 'a/x.mcap', 'b/x.mcap') == ['a-x', 'b-x']
    top = folder.name
    assert named(folder, 'y.mcap', 'q/Y.db3') == [f'{top}-y', 'q-Y']  # equal without case
    assert named(folder, 'z.bag', 'z.mcap') == ['z', 'z-2']
    assert named(folder, 'd.1') == ['d.1']  # a folder has no suffix
    assert named(folder, 'gone/-ü ?.bag') == ['ü_']


def test_names_that_are_known_stay(tree):
    folder = tree('a/x.mcap', 'b/x.mcap', 'c/x.mcap')
    known = {folder / 'b/x.mcap': ['x']}
    assert named(folder, 'a/x.mcap', 'b/x.mcap', known=known) == ['a-x', 'x']
    assert named(folder, 'c/x.mcap', known=known) == ['c-x']  # x is that of another bag


def test_names_that_are_asked_for_are_checked(tree):
    folder = tree('a.mcap', 'b.mcap')

    def names(*asked):
        items = [Item(folder / f'{n}.mcap', name=name) for n, name in zip('ab', asked, strict=True)]
        return names_of(items, {})

    assert names('b', None) == ['b', f'{folder.name}-b']
    with pytest.raises(ConfigError, match=r"b\.mcap: name 'B' is taken; choose another"):
        names('b', 'B')
    for bad in ('../b', '.b', 'b c', ''):
        with pytest.raises(ConfigError, match='must be of letters, digits'):
            names(bad, None)


def test_recording_that_is_named_twice_is_one(tree):
    folder = tree('a/x.mcap')
    twice = [Item(folder / 'a/x.mcap'), Item(folder / 'a/../a/x.mcap')]
    assert without_doubles(twice) == twice[:1]
    other = Item(folder / 'a/x.mcap', reference='@0')
    assert without_doubles([*twice, other]) == [twice[0], other]
