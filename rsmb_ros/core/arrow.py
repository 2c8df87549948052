"""Symmetric matrices of a path's unknowns: a band with a border, solved as such."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ._kernels.fit_row import AHEAD, EXTRA
from ._kernels.normal import factorise, substitute, written_out


@dataclass(frozen=True)
class Arrow:
    """Lower triangle of a symmetric matrix of D path unknowns and the extras."""

    band: np.ndarray  # (D, W): row j + d, column j at [j, d]
    border: np.ndarray  # (D, AHEAD): products of path unknowns with extras
    corner: np.ndarray  # (AHEAD, AHEAD): products of extras

    @classmethod
    def empty(cls, unknowns: int, width: int) -> Arrow:
        """Return an arrow that anything may be written to."""
        return cls(
            np.empty((unknowns, width)), np.empty((unknowns, AHEAD)), np.empty((AHEAD, AHEAD))
        )

    @property
    def parts(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Band, border and corner."""
        return self.band, self.border, self.corner

    def copy(self) -> Arrow:
        """Return an arrow that can be changed."""
        return Arrow(*(part.copy() for part in self.parts))

    def solved(self, *vectors: np.ndarray) -> list[np.ndarray]:
        """Solve for vectors (D + AHEAD,); zeros where the frame holds nothing to learn from."""
        factor = self.copy()
        if not factorise(*factor.parts):
            return [np.zeros_like(vector) for vector in vectors]
        solutions = [vector.copy() for vector in vectors]
        for solution in solutions:
            substitute(*factor.parts, solution)
        return solutions

    def dense(self) -> np.ndarray:
        """Return the lower triangle (D + EXTRA, D + EXTRA)."""
        size = len(self.band) + EXTRA
        out = np.zeros((size, size))
        written_out(*self.parts, out)
        return out
