"""What `rsmb demo` shows: numbers against truth, and pictures."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table as ScreenTable

from rsmb_ros.bags.reading import Bag
from rsmb_ros.core.types import REGISTERED
from rsmb_ros.evaluation.matching import Box, Tally, score_frame
from rsmb_ros.messages.stamps import stamp_ns
from rsmb_ros.report.html import Report, Table
from rsmb_ros.report.sheet import contact_sheet

from .images import write_png

if TYPE_CHECKING:
    from rsmb_ros.ros.playback import Answers

SCENE = '/truth/scene'  # std_msgs/String: JSON with the boxes of the objects in the frame
_SHOWN = {'registered': '/rsmb/registered', 'change mask': '/rsmb/change_mask'}
_OVERLAY = '/rsmb/overlay'

# Stamp of a frame [ns] -> name -> box of the objects in it; empty for a bag without truth.
Truth = Mapping[int, Mapping[str, Box]]


def read_truth(bag: Bag, live: str) -> Truth:
    """Return the truth of the frames of topic `live`: it was recorded at the same time."""
    if all(topic.name != SCENE for topic in bag.topics):
        return {}
    scenes = {time_ns: json.loads(message.data) for _, time_ns, message in bag.messages(SCENE)}
    return {
        stamp_ns(message.header.stamp): {
            name: tuple(box) for name, box in scenes[time_ns]['objects'].items()
        }
        for _, time_ns, message in bag.messages(live)
        if time_ns in scenes
    }


def print_tables(answers: Answers, truth: Truth) -> None:
    """Print the numbers."""
    # a pipe has no width: nothing may be cut off there
    console = Console(width=None if sys.stdout.isatty() else 120)
    for name, value in summary_of(answers, truth).items():
        console.print(f'  {name}: {value}', highlight=False)
    table = object_table(answers, truth)
    shown = ScreenTable(*table.head, box=SIMPLE)
    for row in table.rows:
        shown.add_row(*row)
    console.print(shown if table.rows else 'no truth in the bag: nothing to score')


def summary_of(answers: Answers, truth: Truth) -> dict[str, str]:
    """Return the numbers of the whole run by name."""
    counts = answers.counts
    latencies = [1e3 * (at - answers.played[stamp]) for stamp, at in answers.arrived.items()]
    p50, p95 = np.percentile(latencies, [50, 95])
    summary = {
        'frames played': str(len(answers.played)),
        'frames processed': str(counts['processed']),
        'frames dropped for a newer one': str(counts['dropped']),
        'frames lost before the node': str(len(answers.played) - counts['received']),
        'frames registered': str(
            sum(summary['status'] == REGISTERED for summary in answers.summaries.values())
        ),
        'rate': f'{_hz(answers):.1f} Hz',
        'latency from played to answered': f'p50 {p50:.0f} ms, p95 {p95:.0f} ms',
    }
    if truth:
        tally = _tally(answers, truth)
        alarms = tally.false_alarms
        told = f'{alarms}, {alarms / tally.frames:.2f} per frame'
        summary['other regions (false alarms)'] = told
    return summary


def object_table(answers: Answers, truth: Truth) -> Table:
    """Return what became of each object, among the frames that were processed."""
    tally = _tally(answers, truth)
    rows = [(name, str(n), str(tally.found.get(name, 0))) for name, n in tally.present.items()]
    return Table('Objects', ('object', 'frames present', 'frames found'), rows)


def _hz(answers: Answers) -> float:
    """Return answers per second from the first frame played to the last answer."""
    took = max(answers.arrived.values()) - min(answers.played.values())
    return len(answers.arrived) / took


def _tally(answers: Answers, truth: Truth) -> Tally:
    tally = Tally()
    for stamp, summary in answers.summaries.items():
        tally.add(score_frame(_changes(summary), truth.get(stamp, {})))
    return tally


def _changes(summary: dict) -> list[Box]:
    boxes = [r['bounding_box'] for r in summary['regions'] if r['kind'] == 'change']
    return [(box['x'], box['y'], box['width'], box['height']) for box in boxes]


def write_pictures(folder: Path, answers: Answers, truth: Truth) -> None:
    """
    Write demo.html and demo.png from the recording demo.mcap in `folder`.

    The picture shows the last frame with an object or, without truth, the last frame.
    """
    report = Report('rsmb demo', answers.counts['processed'])
    chosen: dict[str, np.ndarray] = {}
    with Bag(folder / 'demo.mcap') as bag:
        for index, (stamp, pictures) in enumerate(_answered(bag, answers)):
            if report.wants(index):
                text = _described(answers.summaries[stamp], truth.get(stamp, {}))
                report.add(index, f'frame {index}', text, pictures)
            if truth.get(stamp) or not any(truth.values()):
                chosen = pictures
    table = object_table(answers, truth)
    report.write(folder / 'demo.html', summary_of(answers, truth), [table] if table.rows else [])
    del chosen['change mask']  # the overlay has it; four pictures are seen at a glance
    write_png(folder / 'demo.png', contact_sheet(chosen))


def _answered(bag: Bag, answers: Answers) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
    """Iterate over stamp and pictures of the frames that were answered; overlay last."""
    reference_topic = bag.guess_reference().name
    reference = next(bag.frames(reference_topic)).image
    live = bag.guess_live(reference_topic).name
    topics = {live: 'live', **{topic: name for name, topic in _SHOWN.items()}, _OVERLAY: 'overlay'}
    waiting: dict[int, dict[str, np.ndarray]] = {}
    for frame in bag.frames(*topics):
        if frame.stamp_ns not in answers.summaries:
            continue  # dropped: nothing more will come
        pictures = waiting.setdefault(frame.stamp_ns, {})
        pictures[topics[frame.topic]] = frame.image
        if len(pictures) == len(topics):
            del waiting[frame.stamp_ns]
            ordered = {name: pictures[name] for name in topics.values()}
            yield frame.stamp_ns, {'reference': reference, **ordered}


def _described(summary: dict, objects: Mapping[str, Box]) -> str:
    score = score_frame(_changes(summary), objects)
    parts = {
        'found': ', '.join(score.found),
        'missed': ', '.join(score.missed),
        'false alarms': str(len(score.false_alarms)),
    }
    told = ', '.join(f'{name}: {value}' for name, value in parts.items() if value not in ('', '0'))
    return f'{summary["status"]} {summary["reason"]}'.strip() + (f' - {told}' if told else '')
