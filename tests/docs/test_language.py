"""Language of the project: first words of descriptions, American spelling, no private words.

The rules are those of CONTRIBUTING.md, section "Language"; docs/glossary.md holds the words to use.
"""

import ast
import io
import re
import tokenize

import pytest

from tests.helpers.checkout import project_files

PACKAGES = ("jaxik", "training", "hardware")
TEXT = re.compile(r"(\.(py|md|c|h|toml)|Makefile)$")
# In Spanish; generated from docstrings; the lists below.
UNREAD = re.compile(r"^docs/(inicio-rapido\.md|api/)|^tests/docs/test_language\.py$")

OPENING = re.compile(r"(What|Where|Whose|Whether|Which|How|Of that|Said)\b")
DESCRIBED = re.compile(r"^ +(?:(?:\w+, )*\*{0,2}\w+(?: \([^)]*\))?: +|(?:Returns|Yields):\n +)(?=[A-Z])", re.MULTILINE)

BRITISH = re.compile(
    r"(normal|optim|minim|maxim|initial|quant|linear|paramet(e)?r|visual|summar|recogn|organ|real|discret|stabil"
    r"|serial|vector|util|penal|regular|synchron|general|factor|equal|local|special|random|custom|standard|priorit"
    r"|final)is(e|ed|es|er|ers|ing|ation)"
    r"|(col|behavi|neighb|fav|hon|lab|rig|vig)our\w*"
    r"|((milli|centi|kilo)?metre|centre|litre|fibre)[sd]?|centring"
    r"|(mod|lab|trav|sign|lev|chann)ell(ed|ing|er)|cancell(ed|ing)|analys(e|ed|ing)|(def|off|lic)ence"
    r"|analogue|catalogue|artefacts?|programmes?|judgement|grey|whilst|amongst|learnt|spelt|ageing|fulfil"
)
PRIVATE = re.compile(
    r"price[sd]?|pricing|valleys?|outlooks?|stray(s|ed|ing)|hope[sd]?|polish(es|ed|ing)?|dear(er|est)?|whence|unsaid"
)
# Names of other libraries, and quotations.
ALLOWED = {"training/network_files.py": {"serialise"}}


def descriptions(source: str) -> list[tuple[int, str]]:
    """Docstrings, their described arguments and attributes, and comments, by line."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            text = ast.get_docstring(node, clean=False)
            if text:
                line = getattr(node, "lineno", 1)
                found += [(line, text), *((line, text[m.end() :]) for m in DESCRIBED.finditer(text))]
    comments = [t for t in tokenize.generate_tokens(io.StringIO(source).readline) if t.type == tokenize.COMMENT]
    places = {t.start for t in comments}
    found += [(t.start[0], t.string.lstrip("#: ")) for t in comments if (t.start[0] - 1, t.start[1]) not in places]
    return sorted(found)


def words(text: str) -> list[str]:
    """Words of a text in lower case, those inside of names too: ``ColorMap_x`` is color, map, x."""
    return [word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+", text)]


@pytest.fixture(scope="module")
def texts(repository):
    names = [name for name in project_files(repository) if TEXT.search(name) and not UNREAD.search(name)]
    return {name: (repository / name).read_text(encoding="utf-8") for name in names}


@pytest.mark.parametrize("package", PACKAGES)
def test_descriptions_begin_with_a_verb_or_a_noun(package, repository):
    wrong = []
    for file in sorted((repository / package).rglob("*.py")):
        for line, text in descriptions(file.read_text(encoding="utf-8")):
            if OPENING.match(text):
                wrong.append(f"{file.relative_to(repository)}:{line}: {text.splitlines()[0][:80]}")
    assert not wrong, "begin with a verb or a noun phrase:\n" + "\n".join(wrong)


@pytest.mark.parametrize(
    ("kind", "pattern"), [("British spelling", BRITISH), ("private words", PRIVATE)], ids=["British", "private"]
)
def test_no_word_of(kind, pattern, texts):
    wrong = [
        f"{name}:{number}: {word}"
        for name, text in texts.items()
        for number, line in enumerate(text.splitlines(), start=1)
        for word in words(line)
        if pattern.fullmatch(word) and word not in ALLOWED.get(name, ())
    ]
    assert not wrong, f"{kind}:\n" + "\n".join(wrong)


EXAMPLE = '''\
"""What a module holds."""
x = 1  # Where it is


def f():
    """Return x.

    Args:
        a, b: Whether it is.
        c (int): How many there are.
        d: Number of rows, and
            What: goes on.

    Returns:
        Which it is.
    """
    # Said once,
    # What goes on.


class C:
    """The class."""
'''


def test_openings_are_found():
    found = [text.split()[0] for _, text in descriptions(EXAMPLE) if OPENING.match(text)]
    assert sorted(found) == ["How", "Said", "What", "Where", "Whether", "Which"]


def test_words_are_found():
    line = "def NeighbourPrice(centre_of, colourMap): the modelled valleys, 3 metres; otherwise precise, price-less"
    assert [w for w in words(line) if BRITISH.fullmatch(w)] == ["neighbour", "centre", "colour", "modelled", "metres"]
    assert [w for w in words(line) if PRIVATE.fullmatch(w)] == ["price", "valleys", "price"]
