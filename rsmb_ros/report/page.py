"""Templates to pages: one file that needs no network."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jinja2

import rsmb_ros
from rsmb_ros.core.errors import FileProblem

from .words import numbers, percent


def write_page(path: Path, template: str, **values: Any) -> None:
    """
    Write the page that a template makes of `values`.

    Parameters
    ----------
    path : Path
    template : str
        Its file name, in the folder of templates.
    **values
        What it is made of; text is escaped.

    Raises
    ------
    FileProblem
        If the page cannot be written.

    """
    page = rendered(template, **values)
    try:
        path.write_text(page, 'utf-8')
    except OSError as error:
        raise FileProblem(f'{path}: cannot be written: {error.strerror}') from error


def rendered(template: str, **values: Any) -> str:
    """Return the page that a template makes of `values`."""
    environment = jinja2.Environment(
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        loader=jinja2.PackageLoader('rsmb_ros.report'),
        undefined=jinja2.StrictUndefined,
    )
    environment.filters.update(numbers=numbers, percent=percent)
    return environment.get_template(template).render(version=rsmb_ros.__version__, **values)
