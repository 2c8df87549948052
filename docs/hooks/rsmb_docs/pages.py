"""
What a page asks for: ``<!-- generated: NAME -->`` on a line of its own, or in a sentence.

Indented, as in a box that opens, everything that is generated is, too.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable

import rsmb_ros

from . import api, commands, diagnostics, files, parameters, topics

MARK = re.compile(r'(?P<indent>^ *)?<!-- generated: (?P<name>[a-z ]+) -->', re.MULTILINE)
GENERATORS: dict[str, Callable[[], str]] = {
    'version': lambda: rsmb_ros.__version__,
    'parameters': parameters.parameter_tables,
    'parameter rules': parameters.rules,
    'inputs': topics.input_table,
    'compressed inputs': topics.compressed_names,
    'outputs': topics.output_table,
    'output qos': topics.output_qos,
    'services': topics.service_table,
    'verbs': commands.verb_table,
    'commands': commands.command_sections,
    'exit codes': commands.exit_codes,
    'result fields': files.summary_fields,
    'region fields': files.region_fields,
    'row fields': files.row_fields,
    'result example': files.example_json,
    'csv columns': files.csv_columns,
    'detect pictures': files.pictures_of_detect,
    'bag topics': files.bag_topics,
    'diagnostic keys': diagnostics.key_table,
    'verdicts': diagnostics.verdict_table,
    'drop causes': diagnostics.cause_table,
    'diagnostic window': diagnostics.window,
    'api': api.api_sections,
}


def filled(markdown: str) -> str:
    """
    Return a page with everything it asks for.

    Raises
    ------
    KeyError
        If nobody makes what it asks for.

    """

    def generate(mark: re.Match[str]) -> str:
        if mark['name'] not in GENERATORS:
            raise KeyError(f'generated: {mark["name"]} is none of {", ".join(GENERATORS)}')
        return textwrap.indent(GENERATORS[mark['name']](), mark['indent'] or '')

    return MARK.sub(generate, markdown)
