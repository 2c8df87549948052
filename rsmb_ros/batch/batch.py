"""One batch: what is to be done, and the manifest that follows what is."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import rsmb_ros
from rsmb_ros.bags.writing import part_of
from rsmb_ros.core.errors import ConfigError
from rsmb_ros.replay.workers import threads_each

from .crew import Crew, Pulse
from .items import Item, names_of
from .manifest import DONE, FAILED, PENDING, Entry, Manifest
from .tasks import Outcome, Task
from .wishes import OF_MAP, Content, Wish, differences, wish_of

OUTPUT = '.mcap'
# Field of `ReplayJob` -> of the file beside it.
MAP = 'geojson'
SUFFIXES = {'csv': '.csv', 'jsonl': '.jsonl', 'report': '.html', MAP: '.geojson'}


@dataclass(frozen=True)
class BatchJob:
    """What is wanted of a batch."""

    items: Sequence[Item]
    folder: Path  # of the outputs; exists
    workers: int | None = None  # cores here; None: one of another machine for each recording
    content: Content = field(default_factory=Content)
    beside: Sequence[str] = ()  # names of `SUFFIXES`
    again: bool = False  # replay what was done otherwise


@dataclass(frozen=True)
class Planned:
    """One recording, and what is to become of it."""

    name: str
    item: Item
    wish: Wish
    before: Entry | None  # what the manifest says of it
    differs: Sequence[str] = ()  # in what the outputs that are there are other than wished
    done: bool = False  # the outputs that are there are those wished
    kept: bool = False  # the frames that are there are those wished


class Batch:
    """
    Replays what has not been done.

    Parameters
    ----------
    job : BatchJob

    Raises
    ------
    ConfigError
        If an output would replace an input, or a name cannot be used.
    FileProblem
        If the manifest in the folder cannot be read.

    """

    def __init__(self, job: BatchJob) -> None:
        self.job = job
        self._manifest = Manifest(job.folder)
        names = names_of(job.items, self._manifest.names())
        self.plans = [self._planned(*pair) for pair in zip(names, job.items, strict=True)]
        # what was done otherwise than wished now stays as it is
        self.left = [plan for plan in self.plans if plan.differs and not job.again]
        self.to_do = [plan for plan in self.plans if not plan.done and plan not in self.left]
        self._check_outputs()

    def run(self, crew: Crew, pulse: Pulse) -> Generator[Entry, None, None]:
        """
        Replay, and iterate over what became of each recording, when it is in the manifest.

        A recording that is stopped, by whatever `pulse` raises or because everything is killed,
        stays pending.
        """
        plans = {plan.name: plan for plan in self.to_do}
        for plan in plans.values():
            if not plan.kept:  # what is unfinished from now on is of this wish
                part_of(self._outputs(plan.name)['output']).unlink(missing_ok=True)
        self._manifest.put(*(self._entry(plan, PENDING) for plan in plans.values()))
        tasks = [self._task(plan) for plan in plans.values()]
        with crew:
            for outcome in crew.results(tasks, pulse):
                entry = self._entry(plans[outcome.name], *_ended(outcome))
                self._manifest.put(entry)
                yield entry

    def _planned(self, name: str, item: Item) -> Planned:
        wish = wish_of(item, self.job.content)
        before = self._manifest.get(name)
        if before is None:
            return Planned(name, item, wish, before)
        kept = not differences(before.wish, wish, but=OF_MAP)
        if before.status != DONE:
            return Planned(name, item, wish, before, kept=kept)
        outputs = self._outputs(name)
        known = {path for path in outputs.values() if path.name in before.outputs}
        differs = differences(before.wish, wish, but=() if outputs.get(MAP) in known else OF_MAP)
        there = all(path in known and path.is_file() for path in outputs.values())
        done = there and not differs
        return Planned(name, item, wish, before, differs=differs, done=done, kept=kept)

    def _outputs(self, name: str) -> dict[str, Path]:
        """Return the files of a recording by the field of `ReplayJob`."""
        kinds = {'output': OUTPUT, **{kind: SUFFIXES[kind] for kind in self.job.beside}}
        return {kind: self.job.folder / f'{name}{suffix}' for kind, suffix in kinds.items()}

    def _check_outputs(self) -> None:
        inputs = {item.source.resolve() for item in self.job.items}
        inputs |= {Path(i.reference).resolve() for i in self.job.items if i.reference}
        for plan in self.plans:
            for path in self._outputs(plan.name).values():
                if path.resolve() in inputs:
                    raise ConfigError(
                        f'{path} is to be read, and would be written for {plan.item.source}; '
                        'choose another -o'
                    )

    def _task(self, plan: Planned) -> Task:
        item, job, content = plan.item, self.job, self.job.content
        cores = 1 if job.workers is None else job.workers
        at_once = min(cores, len(self.to_do))
        options: dict[str, Any] = {
            'source': item.source,
            'reference': item.reference,
            'topic': item.topic,
            'config': item.config,
            'selection': content.selection,
            'rate': content.rate,
            'compress': content.compress,
            'keep_input': content.keep_input,
            'threads': threads_each(at_once, item.config, cores),
            # an output that is not done may be of any wish: it has its name since then
            'resume': plan.kept and plan.before is not None and plan.before.status == DONE,
            **self._outputs(plan.name),
        }
        if content.geo and MAP in options:
            options[MAP] = replace(content.geo, path=options[MAP])
        return Task(plan.name, options, rsmb_ros.__version__)

    def _entry(self, plan: Planned, status: str, outcome: Outcome | None = None) -> Entry:
        return Entry(
            name=plan.name,
            bag=str(plan.item.source.resolve()),
            status=status,
            outputs=tuple(path.name for path in self._outputs(plan.name).values()),
            wish=plan.wish,
            reason=outcome.reason if outcome else '',
            counts=outcome.counts if outcome else None,
            seconds=outcome.seconds if outcome else 0.0,
            warnings=outcome.warnings if outcome else (),
        )


def _ended(outcome: Outcome) -> tuple[str, Outcome]:
    return (FAILED if outcome.counts is None else DONE), outcome
