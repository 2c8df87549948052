"""`/diagnostics`: keys from a real report, verdicts and causes from the code that gives them."""

from __future__ import annotations

import ast
import math
from collections import Counter
from collections.abc import Iterator

from rsmb_ros.ros.health import WINDOW_S, Health, NodeState
from rsmb_ros.ros.worker import Counts

from .sources import constant, template, tree
from .tables import code, described, table

KEYS = {
    'input rate [Hz]': 'live frames that came and could be read',
    'output rate [Hz]': 'results',
    'latency stamp to published p50 [ms]': 'from the stamp of a frame to its results; empty '
    'without results, and where the stamp is 0',
    'latency stamp to published p95 [ms]': 'likewise, 95th percentile',
    'latency arrival to published p50 [ms]': 'from the arrival of a frame to its results',
    'latency arrival to published p95 [ms]': 'likewise, 95th percentile',
    'frames received': 'since configure',
    'frames processed': 'results made',
    'frames dropped': 'for any cause below',
    'frames waiting': 'in the slot or in work',
    'frames over deadline': 'took longer than `worker.deadline_s`; published all the same',
    'malformed messages': 'on any input; each cause has a line `malformed: CAUSE`',
    'status': '`registered` or `not_registered`, of the last frame',
    'reason': 'why the last frame was not registered',
    'residual mean [grey levels]': 'of the last frame, where judged',
    'row uncertainty median [px]': 'of the last frame',
    'judged [%]': 'share of the last frame that was judged',
    'exposure [rows]': 'of the last frame',
    'reference': '`present` or `absent`',
    'references received': 'that differ from the one before',
    'reference age [s]': 'since it came; empty without one',
    'lifecycle state': '`unconfigured`, `configuring`, `inactive`, `active` or `finalized`',
    'paused': '`true` after `~/enable` with false',
    'worker': '`none`, `compiling`, `idle`, `busy` or `ended`',
    'worker busy [s]': 'how long the present task has been in work',
    'worker alive': '`false` before configure and after the worker has ended',
}
VERDICTS = {
    'the worker thread has ended: restart the node': 'a bug: report the log',
    'in work for ... s, worker.deadline_s = ...': 'kernels of a first depth map compile, or the '
    'machine stands still; restart the node where it does not end',
    'processing failed: ...': 'a bug: report the log line and the frame; the node goes on',
    'not active: ...': '`ros2 lifecycle set /rsmb configure`, then `activate`; or '
    '`autostart: true`',
    '... malformed messages in ... s: ...': 'the driver contradicts itself; the log has the '
    'numbers. `too large`: raise `worker.max_megapixels`',
    'paused by ~/enable': '`ros2 service call /rsmb/enable std_srvs/srv/SetBool "{data: true}"`',
    'no live frame yet': '`ros2 topic info -v` of the topic that the log names after `ready:`; '
    'remap `image`; check `image_transport`',
    'no live frame for ... s': 'camera, driver or network stopped',
    'no reference yet': 'publish one on `reference/image`, or call `~/set_reference`',
    '... frames over worker.deadline_s, up to ... s': 'smaller images, or a larger '
    '`worker.deadline_s`',
    '... odd stamps: ...': '`repeated`: the camera is frozen or its driver repeats frames; '
    '`backwards`, `ahead of the clock`: clocks differ, with a bag set `use_sim_time: true`',
    'no result in the last ... s': 'the worker is busy or every frame is dropped: look at '
    '`dropped: ...`',
    '...: ...': 'status and reason of the last frame: see [Reading diagnostics]'
    '(../how-to/diagnostics.md#nothing-is-registered)',
    '': 'the last frame is registered',
}
# where a cause is named, and what it means
CAUSES = {
    ('ros/worker.py', 'NEWER_FRAME'): 'a newer frame came while the worker was busy',
    ('ros/worker.py', 'EXCEPTION'): 'processing raised; the next frame is processed',
    ('ros/reception.py', 'MALFORMED'): 'the message could not be read',
    ('ros/reception.py', 'PAUSED'): '`~/enable` said false',
    ('ros/reception.py', 'BECAME_REFERENCE'): '`~/set_reference` took it',
    ('ros/answering.py', 'NO_REFERENCE'): 'there was nothing to compare it with',
    ('ros/answering.py', 'REPEATED_STAMP'): 'it has the stamp of the last answer',
    ('ros/answering.py', 'STOPPING'): 'the node was told to end',
    ('ros/outputs.py', 'INACTIVE'): 'the node was deactivated',
}


def key_table() -> str:
    """Return the keys of a report in its order."""
    report = Health().report(
        Counts(), NodeState('active', 'idle', busy_s=0.0, deadline_s=math.inf, paused=False)
    )
    texts = described(report.values, KEYS, __file__)
    return table(('key', 'meaning'), ((code(key), text) for key, text in texts.items()))


def verdict_table() -> str:
    """Return level and message of every verdict, the gravest first."""
    found = list(_verdicts())
    assert not [text for text, n in Counter(text for _, text in found).items() if n > 1]
    texts = described([text for _, text in found], VERDICTS, __file__)
    rows = [
        (level, code(text) if text.strip('.: ') else _last(text), texts[text])
        for level, text in found
    ]
    return table(('level', 'message', 'cause or cure'), rows)


def cause_table() -> str:
    """Return why live frames are dropped."""
    rows = [
        (code(f'dropped: {constant(path, name)}'), text) for (path, name), text in CAUSES.items()
    ]
    return table(('key', 'meaning'), rows)


def window() -> str:
    """Return over how many seconds rates and the verdict go."""
    return f'{WINDOW_S:g} s'


def _last(text: str) -> str:
    return '`not_registered: REASON`' if text else '`registered`'


def _verdicts() -> Iterator[tuple[str, str]]:
    """Yield what `_verdict` and `_verdict_on_frames` of the code can return."""
    found = [
        node
        for function in ast.walk(tree('ros/health.py'))
        if isinstance(function, ast.FunctionDef) and function.name.startswith('_verdict')
        for node in ast.walk(function)
        if isinstance(node, ast.Return) and isinstance(node.value, ast.Tuple)
    ]
    for node in sorted(found, key=lambda one: one.lineno):
        assert isinstance(node.value, ast.Tuple)
        level, message = node.value.elts
        yield ast.unparse(level), template(message)
