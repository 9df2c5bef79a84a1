"""Rules for docstrings: they begin with a verb or a noun, and every assumed value has a reason."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import pytest

from helpers import ROOT

FOLDERS_OF_TCI = sorted(path.parent.name for path in (ROOT / "src" / "tci").glob("*/__init__.py"))
FOLDERS = ("src", "tests", "tools", "examples", "packages")
OPENING = r"(What|Where|When|Which|Who|Whether|How|Why|Of|The same)\b"
"""Words that begin a clause without a main verb, or that refer to another docstring."""
NO_REASON = r"(\bOurs\b|\bAssumed\.[\s\"']*$|no\s+published\s+value)"
"""Words which say that a value is assumed, without a reason for the value."""
RULES = (
    (
        re.compile(OPENING),
        "begins with a clause; valid: a verb in the third person (Returns ...) or a noun phrase (Angle ...)",
    ),
    (
        re.compile(rf".*{NO_REASON}", re.DOTALL),
        "gives no reason; valid: 'Assumed' with the reason for the value, or its consequence",
    ),
)
"""Patterns of docstrings that are not valid, each with advice."""
CANDIDATE = re.compile(rf"""["']\s*{OPENING}|{NO_REASON}""", re.MULTILINE)
"""Pattern of the files that may break a rule. Only these files are parsed, which saves two seconds."""


def docstrings(tree: ast.Module) -> Iterator[ast.Constant]:
    """Yields the docstrings of a module, its classes and functions, and of attributes and constants."""
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if not isinstance(body, list):
            continue
        documented = isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        before = [node if documented else None, *body]
        for owner, statement in zip(before, body, strict=False):
            match statement:
                case ast.Expr(value=ast.Constant(value=str()) as text) if owner is node or isinstance(
                    owner, ast.Assign | ast.AnnAssign
                ):
                    yield text


def faults(source: str) -> list[tuple[int, str]]:
    """Returns line and message of each docstring that breaks a rule."""
    found = []
    for text in docstrings(ast.parse(source)):
        words = " ".join(str(text.value).split())
        sentence = re.split(r"(?<=[.:;?]) ", words)[0]
        found += [(text.lineno, f"{sentence!r} {advice}") for rule, advice in RULES if rule.match(words)]
    return sorted(found)


def test_docstrings_begin_with_a_verb_or_a_noun_and_figures_have_a_reason() -> None:
    wrong = []
    for path in sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        if CANDIDATE.search(source):
            place = path.relative_to(ROOT)
            wrong += [f"{place}:{line}: {message}" for line, message in faults(source)]
    assert not wrong, "\n".join(["", *wrong])


@pytest.mark.parametrize("folder", FOLDERS_OF_TCI)
def test_each_folder_says_in_three_sentences_what_it_is_for(folder: str) -> None:
    text = ast.get_docstring(ast.parse((ROOT / "src" / "tci" / folder / "__init__.py").read_text())) or ""
    sentences = re.split(r"(?<=[.])\s+(?=[A-Z`])", text)
    assert len(sentences) == 3, sentences


@pytest.mark.parametrize(
    ("source", "lines"),
    [
        ('"""What a module does."""', [1]),
        ('def f() -> int:\n    """Whether it is so."""', [2]),
        ('class A:\n    """A thing."""\n    b: int\n    """How many."""', [4]),
        ('X = 1.0\n"""Longest time [s]. Ours."""', [2]),
        ('X = 1.0\n"""Longest time [s]. Assumed."""', [2]),
        ('X = 1.0\n"""Longest time [s]. Assumed; no\npublished value."""', [2]),
        ('if True:\n    X = 1.0\n    """The same as Y."""', [3]),
        ('def f(self) -> None:\n    self.x = 1\n    """\n    Of each joint."""', [3]),
        ('X = 1.0\n"""Longest time [s]. Assumed: ten periods."""', []),
        ('"""Offset of a sensor; nobody asks where."""', []),
        ('def f() -> str:\n    return "What is it?"', []),
        ('print()\n"""Where no docstring is."""', []),
    ],
)
def test_faults_are_found_where_they_are(source: str, lines: list[int]) -> None:
    assert [line for line, _ in faults(source)] == lines
    assert not lines or CANDIDATE.search(source)
