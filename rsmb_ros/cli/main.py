"""Entry point `rsmb`: find the verb, run it, turn errors into one line and an exit code."""

from __future__ import annotations

import argparse
import importlib
import logging
import sys

import rsmb_ros
from rsmb_ros.core.errors import ConfigError, RsmbError
from rsmb_ros.core.workers import take_short_turns

VERBS = {
    'detect': 'compare one live image file with a reference',
    'replay': 'run every frame of a bag through the detector',
    'batch': 'replay many bags, several at once, and go on where it was stopped',
    'play': 'publish the images of a bag on ROS topics',
    'demo': 'play a bag to the real node over ROS and score what it finds',
    'synth': 'make synthetic scenes with truth',
    'evaluate': 'measure accuracy and time against truth, rivals beside ours',
    'ablation': 'measure what each part of the method is worth, switched off alone',
    'speed': 'measure time beside a rival and the floor, over sizes and in a stream',
}

DONE, BAD_DATA, BAD_USAGE, INTERRUPTED = 0, 1, 2, 130


def main(argv: list[str] | None = None) -> int:
    """
    Run `rsmb VERB ...`.

    Returns
    -------
    int
        0 done; 1 bad data; 2 bad usage; 130 interrupted. The reason is one line on stderr.

    """
    take_short_turns()
    argv = sys.argv[1:] if argv is None else argv
    args = _parser(argv[0] if argv else '').parse_args(argv)
    logging.basicConfig(format='rsmb: %(levelname)s: %(message)s', level=logging.WARNING)
    logging.addLevelName(logging.WARNING, 'warning')
    try:
        return args.run(args)
    except ConfigError as error:
        return _fail(str(error), BAD_USAGE)
    except RsmbError as error:
        return _fail(str(error), BAD_DATA)
    except OSError as error:  # a full disk, a folder that may not be written
        where = f'{error.filename}: ' if error.filename else ''
        return _fail(f'{where}{error.strerror or error}', BAD_DATA)
    except KeyboardInterrupt as error:
        hint = f'; {error}' if str(error) else ''
        return _fail(f'interrupted; what was finished is kept{hint}', INTERRUPTED)


def _parser(verb: str) -> argparse.ArgumentParser:
    """Return the parser; only the module of `verb` is imported, the others may be slow."""
    parser = argparse.ArgumentParser(
        prog='rsmb',
        description='Registration and change detection under rolling-shutter motion blur.',
        epilog='Exit codes: 0 done, 1 bad data, 2 bad usage.',
    )
    parser.add_argument('--version', action='version', version=f'rsmb {rsmb_ros.__version__}')
    verbs = parser.add_subparsers(metavar='VERB', required=True)
    for name, summary in VERBS.items():
        entry = verbs.add_parser(
            name, help=summary, description=f'{summary[:1].upper()}{summary[1:]}.'
        )
        if name == verb:
            module = importlib.import_module(f'rsmb_ros.cli.{name}')
            module.add_arguments(entry)
            entry.set_defaults(run=module.run)
    return parser


def _fail(reason: str, code: int) -> int:
    print(f'rsmb: error: {reason}', file=sys.stderr)
    return code


if __name__ == '__main__':
    sys.exit(main())
