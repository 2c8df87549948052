"""The page of a flight: bounded, complete in what it says, the same for the same flight."""

from __future__ import annotations

import re
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest

from rsmb_ros.core import Config
from rsmb_ros.core.errors import FileProblem
from rsmb_ros.report.flight import contents, places, report, shown
from rsmb_ros.report.flight.report import FlightReport

STEP_NS = 33_333_333
LIMIT = 20_000_000  # bytes of a page
VOID = {'meta', 'img', 'input', 'br', 'path', 'rect', 'use'}


class Structure(HTMLParser):
    """Checks that tags are closed, ids are unique, links lead somewhere, pictures have a text."""

    def __init__(self, page):
        super().__init__()
        self.ids, self.links, self.headings, self._open = [], [], [], []
        self.without_text = 0
        self.feed(page)
        assert self._open == []

    def handle_starttag(self, tag, attrs):
        """Note what a tag has."""
        given = dict(attrs)
        if 'id' in given:
            self.ids.append(given['id'])
        if tag == 'a':
            self.links.append(given['href'])
        if re.fullmatch('h[1-6]', tag):
            self.headings.append(int(tag[1]))
        self.without_text += tag == 'img' and 'alt' not in given
        if tag not in VOID:
            self._open.append(tag)

    def handle_endtag(self, tag):
        """Close a tag."""
        if tag not in VOID:
            assert self._open.pop() == tag, f'{tag} at line {self.getpos()}'


def page_of(report, path, *warnings, **facts):
    report.write(path / 'r.html', facts, warnings)
    return (path / 'r.html').read_text('utf-8')


@pytest.fixture
def page(flown, tmp_path):
    """The page of the known flight."""
    return page_of(flown(), tmp_path, recording='a.mcap')


def test_page_is_one_file_and_well_formed(page):
    found = Structure(page)
    assert len(found.ids) == len(set(found.ids))
    assert {link[1:] for link in found.links if link.startswith('#')} <= set(found.ids)
    assert all(link.startswith('#') for link in found.links)
    assert found.without_text == 0
    assert found.headings[0] == 1
    assert max(np.diff(found.headings)) == 1  # no level is left out
    assert not re.search(r'(src|href)="(?!data:image/jpeg|#)', page)
    assert not re.search(r'url\((?!#)|@import|https?://', page)


def test_alarms_come_first(page):
    order = [page.index(f'id="{name}"') for name in ('changes', 'change-1', 'timeline', 'frames')]
    assert order == sorted(order)
    assert '2 places changed, seen in 7 of 12 frames.' in page


def test_one_object_is_one_entry(page):
    assert re.findall(r'id="change-(\d)"', page) == ['1', '2']
    first, second = re.findall(r'id="change-\d".*?</article>', page, re.DOTALL)
    assert 'in 7 frames' in re.sub(r'\s+', ' ', first)
    assert 'score 0.90' in first
    assert 'light only, as a shadow' in second
    assert first.count('<figure') == 3
    assert 'id="static-1"' in page


def test_what_is_not_registered_is_said_and_shown(page):
    assert '2 frames not registered' in page
    frame = re.search(r'id="frame-4".*?</details>', page, re.DOTALL)[0]
    assert 'no overlap: 3% of the frame' in frame
    assert 'Expected' not in frame


def test_what_could_not_be_read_stands_on_top(flown, tmp_path):
    page = page_of(flown(), tmp_path, '3 frames could not be read.')
    assert page.index('3 frames could not be read.') < page.index('id="changes"')


def test_unknown_is_told_in_numbers(page):
    text = re.sub('<[^>]+>', ' ', page)
    assert re.search(r'Unknown in a frame\s+8 %', text)  # 12 of 160 columns
    assert re.search(r'Reference judged\s+9\d %', text)


def test_configuration_shows_first_what_differs(flown, tmp_path):
    config = Config.from_mapping({'change': {'threshold_high': 6.5}})
    page = page_of(flown(config=config), tmp_path)
    head, rest = page.split('All parameters</summary>')
    differs = head.split('What differs from the defaults')[1]
    assert re.findall(r'<th scope="row">(.*?)</th>', differs) == ['change.threshold_high']
    assert '<strong>6.5</strong> sigma' in differs
    assert 'layers.depth_min' in rest
    assert 'Every parameter has its default' in page_of(flown(), tmp_path)


def test_text_is_escaped(flown, tmp_path):
    page = page_of(flown('a <flight>'), tmp_path, recording='<b>&.mcap')
    assert 'a &lt;flight&gt;' in page
    assert '&lt;b&gt;&amp;.mcap' in page


def test_equal_flights_give_equal_pages(flown, tmp_path):
    assert page_of(flown(), tmp_path) == page_of(flown(), tmp_path)


@pytest.mark.parametrize('colored', [False, True])
def test_live_and_reference_may_differ_in_size_and_channels(make, region, tmp_path, colored):
    live = np.full((60, 80, 3), 90, np.uint8)
    reference = np.full((120, 200, 3) if colored else (120, 200), 70, np.uint8)
    flight = FlightReport('r')
    flight.add(0, 0, live, reference, make(live, [region(70, 50, 9, 9)], shift=(300.0, 0.0)))
    assert 'id="change-1"' in page_of(flight, tmp_path)


def test_new_reference_starts_a_new_map(flown, ground, make, region, tmp_path):
    flight = flown()
    other = cv2.flip(ground, 1)
    for n in range(12, 20):
        reference = other if n % 2 else ground
        flight.add(n, n, ground, reference, make(ground, [region(100, 40)]))
    page = page_of(flight, tmp_path)
    assert 'Reference 1 of 8' in page  # the first one of these is the flight's
    assert page.count('class="map card"') == report.MOST_REFERENCES
    assert 'And 4 more references' in page


def test_flight_without_frames_or_without_success_has_a_page(ground, make, tmp_path):
    assert 'There was no frame.' in page_of(FlightReport('r'), tmp_path)
    flight = FlightReport('r')
    flight.add(3, 0, ground, ground, make(ground, reason='no texture in the live frame: 1 < 2'))
    page = page_of(flight, tmp_path)
    assert 'nothing is known about changes' in page
    Structure(page)


def test_flight_without_changes_says_so(ground, make, tmp_path):
    flight = FlightReport('r')
    flight.add(0, 0, ground, ground, make(ground))
    assert 'Nothing changed where it could be judged.' in page_of(flight, tmp_path)


def test_page_that_cannot_be_written_is_a_file_problem(flown, tmp_path):
    with pytest.raises(FileProblem, match=r'no/r\.html: cannot be written'):
        flown().write(tmp_path / 'no' / 'r.html')


@pytest.fixture(scope='module')
def long_flight(make, region):
    """A thousand frames of noise, which no JPEG makes small, with flickers and losses."""
    rng = np.random.default_rng(20170307)
    pictures = [rng.integers(0, 256, (240, 320, 3), dtype=np.uint8) for _ in range(4)]
    flight = FlightReport('long')
    for n in range(1000):
        live = pictures[n % 4]
        x, y = (int(v) for v in rng.integers(0, 200, 2))
        found = [region(200, 100, 60, 40), region(x, y, score=rng.random())]
        found.append(region(80, 180, 50, 50, 0.7, 'static'))
        lost = 'no overlap: 3% of the frame' if n % 50 == 7 else ''
        result = make(live, [] if lost else found, unknown_left=9, reason=lost)
        flight.add(n, n * STEP_NS, live, pictures[0], result)
    return flight


def test_page_of_a_thousand_frames_is_small_and_complete(long_flight, tmp_path):
    page = page_of(long_flight, tmp_path)
    assert 1_000_000 < len(page.encode()) < LIMIT
    found = Structure(page)
    assert {link[1:] for link in found.links} <= set(found.ids)
    assert sum(name.startswith('row-') for name in found.ids) == 1000
    assert 'more places' in page
    number = page.count('<article class="card place change"')
    assert number == contents.MOST_PLACES['change']
    assert page.count('class="hits"') == 1
    assert page.count('<a href') < 600  # bars, pins, strips: a phone can lay it out


def test_a_flight_too_long_for_a_table_still_leads_somewhere(flown, monkeypatch, tmp_path):
    monkeypatch.setattr(contents, 'MOST_ROWS', 11)
    monkeypatch.setattr(report, 'MOST_CHANGED', 1)
    monkeypatch.setattr(report, 'MOST_EVEN', 2)
    found = Structure(page_of(flown(), tmp_path))
    assert {link[1:] for link in found.links} <= set(found.ids)
    frames = [name for name in found.ids if re.match(r'frame-\d', name)]
    assert len(frames) == len([name for name in found.ids if re.match(r'row-\d', name)]) < 8


def test_frames_shown_are_of_every_kind(long_flight):
    frames = [one.record for one in long_flight.frames()]
    kept = report.MOST_CHANGED + report.MOST_LOST + report.MOST_EVEN
    assert kept / 2 < len(frames) <= kept
    assert sum(not one.registered for one in frames) >= report.MOST_LOST / 2
    assert max(np.diff([one.index for one in frames])) < 260


def test_worst_page_stays_below_the_limit():
    """If every picture were as large as it may be, and every outline as long."""
    frames = report.MOST_CHANGED + report.MOST_LOST + report.MOST_EVEN
    frame = 2 * shown.FRAME[1] + shown.THUMBNAIL[1]
    place = 3 * shown.CROP[1] + places.STRIP * shown.GLIMPSE[1]
    jpegs = (
        frames * frame
        + sum(contents.MOST_PLACES.values()) * place
        + report.MOST_REFERENCES * report.REFERENCE[1]
    )
    point = len('L123.4 123.4')
    outlines = point * (frames * (2 * 1500 + 9 * 160) + 3 * 400 * 60 + 1500 * 4)
    rows = 300 * contents.MOST_ROWS
    assert 4 / 3 * jpegs + outlines + rows < 0.97 * LIMIT
