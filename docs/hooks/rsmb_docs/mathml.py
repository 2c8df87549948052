r"""
Equations as MathML, which browsers draw without a script or a font of ours.

Reads the part of LaTeX that the pages use; what it does not know it refuses, so that no page shows
a command instead of a formula.
"""
# ruff: noqa: RUF001 - signs of mathematics that look like letters are meant

from __future__ import annotations

import html
import re

TOKEN = re.compile(r'\\[A-Za-z]+|\\.|[{}^_&]|\d+(?:\.\d+)?|\s+|.', re.DOTALL)
LETTERS = {
    'alpha': 'α', 'beta': 'β', 'gamma': 'γ', 'delta': 'δ', 'epsilon': 'ε', 'zeta': 'ζ', 'eta': 'η',
    'theta': 'θ', 'kappa': 'κ', 'lambda': 'λ', 'mu': 'μ', 'nu': 'ν', 'xi': 'ξ', 'pi': 'π',
    'rho': 'ρ', 'sigma': 'σ', 'tau': 'τ', 'phi': 'φ', 'chi': 'χ', 'psi': 'ψ', 'omega': 'ω',
    'Delta': 'Δ', 'Sigma': 'Σ', 'Phi': 'Φ', 'Psi': 'Ψ', 'Omega': 'Ω',
    'infty': '∞', 'ell': 'ℓ', 'partial': '∂', 'nabla': '∇',
}  # fmt: skip
OPERATORS = {
    'cdot': '⋅', 'times': '×', 'ge': '≥', 'le': '≤', 'ne': '≠', 'approx': '≈', 'in': '∈', 'to': '→',
    'pm': '±', 'dots': '…', 'sum': '∑', 'prod': '∏', 'int': '∫', 'mapsto': '↦', 'ast': '∗',
    'lbrace': '{', 'rbrace': '}', 'propto': '∝', 'odot': '⊙', 'mid': '∣', 'll': '≪',
}  # fmt: skip
FENCES = {'{': '{', '}': '}', '|': '‖', 'lfloor': '⌊', 'rfloor': '⌋', 'langle': '⟨', 'rangle': '⟩'}
LARGE = {'sum', 'prod'}  # their bounds stand below and above in a displayed equation
WORDS = ('exp', 'log', 'min', 'max', 'median', 'huber', 'rank', 'erf', 'round', 'med')
SPACES = {'quad': '1em', 'qquad': '2em', ',': '0.17em', ';': '0.28em', ' ': '0.25em'}
SIGNS = {'-': '−', "'": '′', '*': '∗'}
ACCENTS = {'hat': '^', 'tilde': '~', 'bar': '‾', 'dot': '˙'}


class MathError(ValueError):
    """An equation uses what is not known here."""


def mathml(latex: str, display: bool = False) -> str:
    """
    Return an equation as a ``<math>`` element.

    Raises
    ------
    MathError
        If it holds an unknown command or its braces do not match.

    """
    parser = _Parser(latex, display)
    inside = parser.row(until='')
    kind = ' display="block"' if display else ''
    return f'<math{kind}>{inside}</math>'


def _element(name: str, inside: str, attributes: str = '') -> str:
    return f'<{name}{attributes}>{inside}</{name}>'


class _Parser:
    """Recursive descent over the tokens of one equation."""

    def __init__(self, latex: str, display: bool) -> None:
        self._latex = latex
        self._display = display
        self._tokens = TOKEN.findall(latex)
        self._at = 0

    def row(self, until: str) -> str:
        """Read up to `until` and return one element."""
        parts = []
        while (token := self._peek()) != until:
            if not token or token == '}':
                raise self._wrong(f'{until or "the end"} expected, {token or "the end"} found')
            parts.append(self._scripted())
        self._next()
        alone = until == '}' and len(parts) == 1
        return parts[0] if alone else _element('mrow', ''.join(parts))

    def _scripted(self) -> str:
        """Read one thing with what stands below and above it."""
        token = self._peek()
        base = self._thing()
        low = high = ''
        while self._peek() in ('_', '^'):
            if self._next() == '_':
                low = self._thing()
            else:
                high = self._thing()
        if not (low or high):
            return base
        under = self._display and token.lstrip('\\') in (*LARGE, 'min', 'max', 'median')
        names = ('munder', 'mover', 'munderover') if under else ('msub', 'msup', 'msubsup')
        which = 2 if low and high else 0 if low else 1
        return _element(names[which], base + low + high)

    def _thing(self) -> str:
        token = self._next()
        if token == '{':
            return self.row(until='}')
        if token.startswith('\\'):
            return self._command(token[1:])
        if token in ('', '}', '^', '_', '&'):
            raise self._wrong(f'{token or "the end"} stands where something is expected')
        if token[0].isdigit():
            return _element('mn', token)
        if token.isalpha():
            return _element('mi', token)
        if token == '|':
            return _element('mo', token, ' stretchy="false" lspace="0" rspace="0"')
        if token in '()[]':  # as large as they are written; \left and \right stretch
            return _element('mo', token, ' stretchy="false"')
        return _element('mo', SIGNS.get(token, html.escape(token)))

    def _command(self, name: str) -> str:
        if name in LETTERS:
            return _element('mi', LETTERS[name])
        if name in OPERATORS:
            return _element('mo', OPERATORS[name])
        if name in SPACES:
            return f'<mspace width="{SPACES[name]}"></mspace>'
        if name in FENCES:
            return _element('mo', FENCES[name], ' stretchy="false"')
        if name in WORDS:
            return _element('mi', name)
        return self._structure(name)

    def _structure(self, name: str) -> str:
        if name == 'frac':
            return _element('mfrac', self._thing() + self._thing())
        if name == 'sqrt':
            return _element('msqrt', self._thing())
        if name in ACCENTS:
            accent = _element('mo', ACCENTS[name], ' stretchy="false"')
            return _element('mover', self._thing() + accent, ' accent="true"')
        if name == 'text':
            return _element('mtext', self._words())
        if name in ('mathbf', 'mathrm'):
            kind = {'mathbf': 'bold', 'mathrm': 'normal'}[name]
            return _letters(self._words(), kind)
        if name == 'left':
            return self._fenced()
        if name == 'begin':
            return self._cases()
        raise self._wrong(f'\\{name} is not known')

    def _fenced(self) -> str:
        """Read what stands between \\left( and \\right)."""
        parts = [self._fence()]
        while (token := self._peek()) != '\\right':
            if token in ('', '}'):
                raise self._wrong('\\right expected')
            parts.append(self._scripted())
        self._next()
        return _element('mrow', ''.join([*parts, self._fence()]))

    def _fence(self) -> str:
        token = self._next().removeprefix('\\')
        fence = html.escape(FENCES.get(token, token)).replace('.', '')
        return _element('mo', fence, ' fence="true" stretchy="true"')

    def _cases(self) -> str:
        """Read \\begin{cases} ... \\end{cases}."""
        if self._words() != 'cases':
            raise self._wrong('only \\begin{cases} is known')
        rows: list[list[list[str]]] = [[[]]]
        while True:
            token = self._peek()
            if token == '\\end':
                break
            if token == '&':
                self._next()
                rows[-1].append([])
            elif token == '\\\\':
                self._next()
                rows.append([[]])
            elif token:
                rows[-1][-1].append(self._scripted())
            else:
                raise self._wrong('\\end{cases} expected')
        self._next()
        self._words()
        lines = ''.join(
            _element(
                'mtr',
                ''.join(_element('mtd', ''.join(cell), ' style="text-align:left"') for cell in row),
            )
            for row in rows
        )
        brace = _element('mo', '{', ' fence="true" stretchy="true"')
        return _element('mrow', brace + _element('mtable', lines))

    def _words(self) -> str:
        """Read {...} as it is written, spaces included."""
        if self._next() != '{':
            raise self._wrong('{ expected')
        words = []
        while (token := self._tokens[self._at] if self._at < len(self._tokens) else '') != '}':
            if not token:
                raise self._wrong('} expected')
            words.append(token)
            self._at += 1
        self._at += 1
        return html.escape(''.join(words))

    def _peek(self) -> str:
        """Return the next token that is no space, '' at the end."""
        while self._at < len(self._tokens) and self._tokens[self._at].isspace():
            self._at += 1
        return self._tokens[self._at] if self._at < len(self._tokens) else ''

    def _next(self) -> str:
        token = self._peek()
        self._at += 1
        return token

    def _wrong(self, why: str) -> MathError:
        return MathError(f'equation {self._latex!r}: {why}; see docs/hooks/rsmb_docs/mathml.py')


def _letters(text: str, kind: str) -> str:
    """Return letters, upright; bold ones are other characters, as MathML Core wants them."""
    if kind == 'bold':
        text = ''.join(_bold(letter) for letter in text)
    return _element('mi', text, ' mathvariant="normal"')


def _bold(letter: str) -> str:
    if 'a' <= letter <= 'z':
        return chr(0x1D41A + ord(letter) - ord('a'))
    if 'A' <= letter <= 'Z':
        return chr(0x1D400 + ord(letter) - ord('A'))
    return letter
