"""In a real browser: scripts run, pictures compare, nothing is wider than a phone."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess

import pytest

BROWSERS = ('chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable')
DEADLINE_S = 60
PHONE, DESKTOP = (390, 844), (1280, 900)  # px

WATCH = """<script>
window.problems = [];
addEventListener('error', (event) => window.problems.push(event.message || 'resource'), true);
addEventListener('securitypolicyviolation', (event) => window.problems.push('policy'));
</script>"""
# What a person would do, and what must come of it.
USE = """<script>
addEventListener('load', () => {
  const found = {};
  const choose = (box, mode) => { box.querySelector(`[value=${mode}]`).click(); };
  const style = (node) => getComputedStyle(node);
  const box = document.querySelector('#change-1 .compare');
  const stage = box.querySelector('.stage');
  const live = stage.querySelector('.live');
  found.sideBySide = [...stage.querySelectorAll('figure')].filter((f) => f.offsetWidth).length;
  choose(box, 'swipe');
  const area = stage.getBoundingClientRect();
  stage.dispatchEvent(new PointerEvent('pointerdown', { clientX: area.left + area.width / 4 }));
  found.swiped = style(live.querySelector('.view')).clipPath;
  const range = stage.querySelector('.swipe');
  found.swipeShown = style(range).display;
  range.value = 80;
  range.dispatchEvent(new Event('input'));
  found.swipedByKey = stage.style.getPropertyValue('--x');
  choose(box, 'blink');
  found.blinks = live.getAnimations().map((a) => a.animationName + ' ' + a.playState);
  const outlines = () => style(live.querySelector('.drawn')).display;
  found.outlines = [outlines()];
  document.querySelector('#outlines').click();
  found.outlines.push(outlines());
  const lanes = document.querySelector('.lanes');
  for (const key of ['ArrowRight', 'ArrowRight', 'Enter'])
    lanes.dispatchEvent(new KeyboardEvent('keydown', { key, bubbles: true }));
  found.readout = document.querySelector('.readout').textContent;
  found.hash = location.hash;
  found.broken = [...document.images].filter((i) => i.complete && !i.naturalWidth).length;
  for (const one of document.querySelectorAll('details')) one.open = true;
  requestAnimationFrame(() => setTimeout(() => {
    found.width = document.documentElement.scrollWidth;
    found.inner = innerWidth;
    found.opened = document.querySelector(location.hash).open;
    found.small = [...document.querySelectorAll('.modes label, .jump a')]
      .filter((node) => node.offsetHeight && node.offsetHeight < 24).length;
    found.dark = style(document.body).backgroundColor;
    found.problems = window.problems;
    parent.postMessage(JSON.stringify(found), '*');
  }, 100));
});
</script>"""
# A window is never narrower than 500 px; a frame inside it is as narrow as a phone.
SCREEN = """<!DOCTYPE html><pre id="found"></pre>
<iframe src="watched.html" width="{}" height="{}" style="border: 0"></iframe>
<script>
addEventListener('message', (event) => {{
  document.querySelector('#found').textContent = event.data;
}});
</script>"""


@pytest.fixture(scope='module')
def browser():
    """Return the path of Chromium."""
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    if path is None:
        pytest.skip(f'none of {", ".join(BROWSERS)} is installed')
    return path


@pytest.fixture(scope='module')
def used(browser, flown, tmp_path_factory):
    """Use the page on a screen of some size; returns what came of it."""
    folder = tmp_path_factory.mktemp('page')
    flown().write(folder / 'page.html')
    page = (folder / 'page.html').read_text('utf-8')
    watched = page.replace('<head>', f'<head>{WATCH}', 1).replace('</body>', f'{USE}</body>')
    (folder / 'watched.html').write_text(watched, 'utf-8')

    def use(size, *options):
        command = [browser, '--headless', '--no-sandbox', '--disable-gpu', '--dump-dom']
        (folder / 'screen.html').write_text(SCREEN.format(*size))
        command += ['--window-size=1400,1000', f'--user-data-dir={folder / "profile"}']
        # no name can be resolved: whatever the page wanted to fetch would fail
        command += ['--host-resolver-rules=MAP * ~NOTFOUND', '--virtual-time-budget=5000']
        command += [*options, (folder / 'screen.html').as_uri()]
        done = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE_S)
        found = re.search(r'<pre id="found">(.+?)</pre>', done.stdout, re.DOTALL)
        assert found, f'the script did not run: {done.stderr[-2000:]}'
        return json.loads(html.unescape(found[1]))

    return use


@pytest.fixture(scope='module')
def desktop(used):
    """What came of it on a desktop."""
    return used(DESKTOP)


@pytest.fixture(scope='module')
def phone(used):
    """What came of it on a phone."""
    return used(PHONE)


def test_page_runs_without_errors(desktop, phone):
    for found in (desktop, phone):
        assert found['problems'] == []
        assert found['broken'] == 0


def test_nothing_is_wider_than_the_screen_with_everything_open(desktop, phone):
    assert (phone['inner'], desktop['inner']) == (PHONE[0], DESKTOP[0])
    for found in (desktop, phone):
        assert found['width'] <= found['inner']
        assert found['small'] == 0  # large enough for a finger


def test_swipe_follows_pointer_and_keys(desktop):
    assert desktop['sideBySide'] == 3
    assert desktop['swiped'] == 'inset(0px 0px 0px 25%)'
    assert desktop['swipeShown'] == 'block'
    assert desktop['swipedByKey'] == '80%'


def test_blink_blinks(desktop):
    assert desktop['blinks'] == ['blink running']


def test_outlines_can_be_hidden(desktop):
    assert desktop['outlines'][0] != 'none'
    assert desktop['outlines'][1] == 'none'


def test_timeline_is_used_with_the_keyboard(desktop):
    assert desktop['hash'] == '#frame-1'
    assert desktop['opened']
    assert desktop['readout'].startswith('frame 1, 0.1 s: no change')


def test_dark_where_the_system_is_dark(desktop, used):
    dark = used(DESKTOP, '--blink-settings=preferredColorScheme=0')
    assert dark['dark'] != desktop['dark']
    assert max(map(int, re.findall(r'\d+', dark['dark']))) < 40
