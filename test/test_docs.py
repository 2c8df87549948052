"""The documentation: generated from the code as it is, complete, and built without warnings."""

from __future__ import annotations

import argparse
import ast
import dataclasses
import os
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
import yaml

pytest.importorskip('rclpy', reason='the reference is generated from the node')

from rsmb_docs import api, commands, diagnostics, files, parameters, topics
from rsmb_docs.mathml import MathError, mathml
from rsmb_docs.pages import GENERATORS, filled
from rsmb_docs.sources import template, tree
from rsmb_docs.tables import described, table

from rsmb_ros import core
from rsmb_ros.cli.main import VERBS
from rsmb_ros.core import config
from rsmb_ros.messages.outputs import OUTPUTS
from rsmb_ros.ros.parameters import OF_THE_NODE, describe

ROOT = Path(__file__).parents[1]
DOCS = ROOT / 'docs'
PAGES = sorted(path for path in DOCS.rglob('*.md'))
BUILD_S = 120.0


def names(paths):
    return [str(path.relative_to(DOCS)) for path in paths]


@pytest.fixture(params=PAGES, ids=names(PAGES))
def page(request):
    """Path of each page, in turn."""
    return request.param


# -- generated reference -----------------------------------------------------------------------


def test_every_parameter_is_listed_with_default_range_type_and_changeability():
    lines = parameters.parameter_tables().splitlines()
    every = [*config.parameters(), *OF_THE_NODE]
    for one in every:
        (line,) = (line for line in lines if f'id="{one.name}"' in line)
        assert f'| {one.allowed()} | {one.doc.replace("|", chr(92) + "|")} |' in line
        assert f'| `{str(one.default).lower()}` |' in line.lower()
        assert ('fixed' in line) == describe(one).read_only
        assert parameters.TYPES[type(one.default)] in line
    assert sum('<a id=' in line for line in lines) == len(every)


def test_parameters_that_contradict_each_other_are_told():
    assert parameters.rules().count('\n- ') == 2


def test_every_topic_and_service_of_the_node_is_listed():
    read, written = topics.input_table(), topics.output_table()
    for name in ('image', 'reference/image', 'reference/depth', 'camera_info'):
        assert f'| `{name}` |' in read
    assert 'transient local' in read
    for output in OUTPUTS:
        assert f'| `~/{output.name}` | {output.type.replace("/msg/", "/")} |' in written
    assert '| `~/regions` | vision_msgs/Detection2DArray |' in written
    assert '| `/diagnostics` | diagnostic_msgs/DiagnosticArray |' in written
    assert '`image/compressed`' in topics.compressed_names()
    services = topics.service_table()
    assert '| `~/enable` | std_srvs/SetBool |' in services
    assert '| `~/set_reference` | std_srvs/Trigger |' in services


def test_every_argument_of_every_verb_is_listed():
    text = commands.command_sections()
    for verb, parser in commands.parsers():
        section = text.split(f'## rsmb {verb}\n')[1].split('\n## ')[0]
        actions = [action for action in parser._actions if action.dest != 'help']
        assert actions
        for action in actions:
            shown = action.option_strings[-1] if action.option_strings else action.metavar
            assert (shown or action.dest.upper()) in section
            if action.help and action.help is not argparse.SUPPRESS and '%' not in action.help:
                # an unescaped bar would end the cell
                assert action.help.split('|')[0] in section
    assert all(f'(#rsmb-{verb})' in commands.verb_table() for verb in VERBS)


def test_every_field_of_a_result_is_listed():
    region, summary = files.region_fields(), files.summary_fields()
    for name in files.example():
        assert f'| `{name}` |' in summary
    renamed = {name: f'bounding_box.{name}' for name in ('x', 'y', 'width', 'height')}
    for field in dataclasses.fields(core.Region):
        name = renamed.get(field.name, 'area_px' if field.name == 'area' else field.name)
        assert f'| `{name}` |' in region
    assert '| `id` | integer or null |' in region
    assert all(f'`{name}' in files.row_fields() for name in core.MOTION_COLUMNS)


def test_every_key_and_verdict_of_the_diagnostics_is_listed():
    assert '| `residual mean [grey levels]` |' in diagnostics.key_table()
    verdicts = diagnostics.verdict_table()
    assert '| STALE | `no live frame yet` |' in verdicts
    assert verdicts.index('| ERROR |') < verdicts.index('| WARN |') < verdicts.index('| OK |')
    assert '| `dropped: newer frame` |' in diagnostics.cause_table()


def test_everything_that_core_exports_is_described():
    text = api.api_sections()
    for name in core.__all__:
        assert f'## {name}\n' in text or f'| `{name}` |' in text
    for method in ('detect', 'camera_for'):
        assert f'### Detector.{method}\n' in text
    assert '- `FrameError`<br>If `live` is not such an array.' in text


def test_a_list_that_was_true_once_is_refused():
    with pytest.raises(KeyError, match="no text for \\['new'\\], text for \\['old'\\]"):
        described(['kept', 'new'], {'kept': 'a', 'old': 'b'}, 'here')


def test_a_bar_ends_a_cell_only_outside_code():
    assert table(('a',), [('`x|y` or p|q',)]).splitlines()[-1] == r'| `x|y` or p\|q |'


# -- equations ---------------------------------------------------------------------------------


def test_equations_become_mathml():
    assert mathml('x_i^2') == (
        '<math><mrow><msubsup><mi>x</mi><mi>i</mi><mn>2</mn></msubsup></mrow></math>'
    )
    assert '<mfrac><mi>t</mi><mi>d</mi></mfrac>' in mathml(r'\frac{t}{d}')
    assert '<munder><mo>∑</mo><mi>k</mi></munder>' in mathml(r'\sum_k', display=True)
    assert '<mtext>two words</mtext>' in mathml(r'\text{two words}')
    assert mathml('a < b').count('&lt;') == 1


@pytest.mark.parametrize('wrong', [r'\unheard', '{x', 'x}', 'x_', r'\text x'])
def test_equations_that_cannot_be_drawn_are_refused(wrong):
    with pytest.raises(MathError, match='equation'):
        mathml(wrong)


def test_every_equation_of_the_pages_can_be_drawn(page):
    text = re.sub(r'```.*?```|`[^`]*`', '', page.read_text('utf-8'), flags=re.DOTALL)
    for block, inline in re.findall(r'\$\$(.+?)\$\$|\$([^$]+?)\$', text, flags=re.DOTALL):
        mathml(block or inline, display=bool(block))


# -- pages -------------------------------------------------------------------------------------


def test_everything_that_a_page_asks_for_is_generated(page):
    assert '<!-- generated' not in filled(page.read_text('utf-8'))


def test_everything_that_is_generated_is_asked_for():
    asked = {
        name for path in PAGES for name in re.findall('generated: ([a-z ]+) ', path.read_text())
    }
    assert asked == set(GENERATORS)


def test_links_lead_to_files(page):
    for target in re.findall(r'\]\(([^)\s]+)\)', page.read_text('utf-8')):
        if not target.startswith('#'):
            assert (page.parent / target.split('#')[0]).is_file(), f'{page}: {target}'


def test_parameters_that_pages_name_exist(page):
    known = {one.name for one in config.parameters()}
    groups = {name.split('.')[0] for name in known}
    for group, key in re.findall(r'`(?:config\.)?([a-z]+)\.([a-z_]+)\b', page.read_text('utf-8')):
        if group in groups and key not in ('persistence_', 'yaml'):
            assert f'{group}.{key}' in known, f'{page}: {group}.{key}'


def test_messages_that_the_how_to_explains_are_messages_of_the_code():
    said = [
        template(node)
        for path in ('ros/health.py', 'core/detector.py', 'core/verdict.py')
        for node in ast.walk(tree(path))
        if isinstance(node, ast.Constant | ast.JoinedStr)
    ]
    text = (DOCS / 'how-to' / 'diagnostics.md').read_text('utf-8')
    rows = re.findall(r'^\| (?:WARN |STALE |ERROR )?`([^`]+)` \|', text, flags=re.MULTILINE)
    quoted = [row for row in rows if not row.startswith('dropped: ')]
    assert len(quoted) > 10
    for message in quoted:
        (longest, *_) = sorted(re.split(r'\.\.\.| N | CAUSE', message), key=len, reverse=True)
        assert any(longest.strip() in one for one in said), f'nobody says {message!r}'


def test_commands_that_pages_show_are_understood(page):
    known = {
        verb: {option for action in parser._actions for option in action.option_strings}
        for verb, parser in commands.parsers()
    }
    for block in re.findall(r'```bash\n(.*?)```', page.read_text('utf-8'), flags=re.DOTALL):
        for line in block.replace('\\\n', ' ').splitlines():
            words = shlex.split(line, comments=True)
            if words and words[0] == 'rsmb':
                options = {word for word in words[2:] if word.startswith('-')}
                assert options <= known[words[1]], f'{page}: {line}'


def test_pages_tell_nothing_of_the_machine_they_were_written_on(page):
    text = page.read_text('utf-8')
    for trace in {tempfile.gettempdir(), str(ROOT), str(Path.home())} - {'/'}:
        assert trace not in text


def test_pictures_are_used_and_small():
    text = ''.join(path.read_text('utf-8') for path in PAGES) + (ROOT / 'mkdocs.yml').read_text()
    pictures = list((DOCS / 'images').iterdir())
    for path in pictures:
        assert f'images/{path.name}' in text, f'{path.name} is in no page'
        assert path.stat().st_size <= 200_000
    assert sum(path.stat().st_size for path in pictures) < 1_000_000


def test_every_page_is_in_the_navigation():
    def leaves(entry):
        if isinstance(entry, str):
            return [entry]
        inside = entry.values() if isinstance(entry, dict) else entry
        return [leaf for one in inside for leaf in leaves(one)]

    nav = yaml.safe_load((ROOT / 'mkdocs.yml').read_text())['nav']
    assert sorted(leaves(nav)) == sorted(names(PAGES))


# -- the site ----------------------------------------------------------------------------------


@pytest.fixture(scope='module')
def site(tmp_path_factory):
    """Folder of the site."""
    pytest.importorskip('mkdocs')
    pytest.importorskip('material')
    folder = tmp_path_factory.mktemp('site')
    built = subprocess.run(
        [sys.executable, '-m', 'mkdocs', 'build', '--quiet', '--strict', '--site-dir', folder],
        cwd=ROOT,
        env={**os.environ, 'NO_MKDOCS_2_WARNING': '1'},
        capture_output=True,
        text=True,
        timeout=BUILD_S,
    )
    assert (built.returncode, built.stdout, built.stderr) == (0, '', '')
    return folder


def test_site_is_built_without_a_warning(site):
    assert {path.stem for path in site.rglob('*.html')} >= {path.stem for path in PAGES}
    assert not list(site.rglob('*.py'))


def test_site_asks_nobody_else_for_anything(site):
    for path in [*site.rglob('*.html'), *site.glob('assets/*.css')]:
        loaded = re.findall(r'(?:src|href|url\()=?"?((?:https?:)?//[^"\s)]+)', path.read_text())
        assert not loaded, f'{path}: {loaded}'


def test_site_shows_equations_and_can_be_searched_from_the_disk(site):
    method = (site / 'explanation' / 'method.html').read_text('utf-8')
    assert method.count('<math display="block">') >= 7
    assert 'arithmatex' not in method
    assert (site / 'search' / 'search_index.js').read_text('utf-8').startswith('var __index = {')
    assert 'assets/file-worker.js' in method
