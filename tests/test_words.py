"""Words and sentences: can a reader who is no native speaker understand every page and message?

1. a sentence of a hand-typed page has at most 25 words;
2. private words occur neither in pages nor in comments, messages, descriptions and names.

`python tests/test_words.py FILE ...` lists the findings of some files; without a file, of all.
The words and what to write instead are in `.github/CONTRIBUTING.md`.
"""

import io
import json
import re
import sys
import tokenize
from pathlib import Path

from programs import call

ROOT = Path(__file__).resolve().parent.parent
LONGEST_SENTENCE = 25  # [words]

# Folders and files that are not rewritten yet. An empty list means: everything is checked.
NOT_YET = ()
# Written by programs or by others.
NOT_OURS = (
    "modelDescription/licenses/",
    "modelDescription/trade/",
    "tests/data/",
    "tests/fuzz/corpus/",
    "tests/test_words.py",
    "tests/validation/",
)
TYPED = ("tests/validation/README.md",)  # by hand, among pages that programs write

# Private word: what to write instead.
WORDS = {
    r"told|tells?|telling|untold": "received, reported, prescribed; a warning is issued",
    r"(?:a|the|first|each|every) gets?": "a getter call",
    r"(?:its|their|the|whose|out of) reach|reach of": "workspace limit, bounding radius, range",
    r"leaps?|leaping": "step over a singularity; ballistic propagation",
    r"flights?|flown": "free drift; quiescent mechanism",
    r"resting": "quiescent",
    r"truths?": "reference solution",
    r"owes?|owed|owing": "pending impulse",
    r"ledgers?": "impulse balance",
    r"sinks?": "dissipated energy",
    r"troubles?": "failure status",
    r"dear|dearer|dearest": "expensive",
    r"besides?": "next to; as well as; compared with",
    r"who|whom|whoever|somebody|nobody|everybody|anybody|someone": "name the person or the thing",
    r"please": "(leave it out)",
}
WORD = re.compile(r"\b(?:" + "|".join(f"(?:{word})" for word in WORDS) + r")\b", re.IGNORECASE)
# Names have parts: find_told_state, kToldLate, TOLD_LATE. Only these words are looked for in them.
NAME_PARTS = {
    *("told", "untold", "leap", "leaps", "flight", "flown", "resting", "truth", "owed", "ledger"),
    *("ledgers", "sink", "sinks", "trouble", "dear", "beside", "nobody", "somebody", "please"),
}
# Exceptions: names of the public interface, and of headers whose folder is in NOT_YET.
ALLOWED = re.compile(
    r"model(\.|__)flight"  # a variable of the FMU
    r"|flight(?=\.md|\.py)"  # a page of tests/validation and the study that writes it
    r'|"flight"|"resting"|`resting`|one of resting'  # a value of model.flight
    r'|"beside window"|`beside window`|kBesideWindow'  # a value of capture.reason
    r"|dockloop(-compare)? truth|trade \| truth|_truth\.json|\"truth\"|'truth'"  # the command
    r"|(?:\w+[/.])?truth\.[ch]pp|\w+[/.]truth(\.py)?|``?truth(\.py)?``?|\(main\|truth\|"
    r"|test_flight|test_truth|truth_test"
)
ALLOWED_NAMES = {
    "flight",  # Parameters: model.flight
    "kBesideWindow",  # a value of capture.reason
}
CODE = {".cpp", ".hpp", ".c"}
HASH = {".toml", ".cmake", ".sh", ".yaml", ".yml", ""}


def list_files():
    """Names of all files of the repository, also of those that are not committed yet."""
    listed = call("git", "ls-files", "--cached", "--others", "--exclude-standard", cwd=ROOT)
    return [name for name in listed.split("\n") if (ROOT / name).is_file()]


def files():
    """Files of the repository that are checked."""
    for name in list_files():
        is_written = name.startswith(NOT_OURS) and name not in TYPED
        if not (name.startswith(NOT_YET) or is_written):
            yield name


# ------------------------------------------------------------------ what people read in a file


def _code_parts(text):
    """Comments and string literals of C++, as (line, text, whether it is a name)."""
    pattern = re.compile(
        r'//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])\'|#include[^\n]*|[A-Za-z_]\w*',
        re.DOTALL,
    )
    for match in pattern.finditer(text):
        part = match.group()
        line = text.count("\n", 0, match.start()) + 1
        if part.startswith(("//", "/*", '"')):
            for i, piece in enumerate(part.split("\n")):
                yield line + i, piece, False
        elif not part.startswith(("#include", "'")):
            yield line, part, True


def _python_parts(text):
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.NAME:
            yield token.start[0], token.string, True
        elif token.type in (tokenize.COMMENT, tokenize.STRING) or token.type == getattr(
            tokenize, "FSTRING_MIDDLE", -1
        ):
            for i, piece in enumerate(token.string.split("\n")):
                yield token.start[0] + i, piece, False


def _json_parts(text):
    def walk(value):
        if isinstance(value, dict):
            for key, inner in value.items():
                if isinstance(inner, str) and key in ("comment", "description", "title"):
                    yield inner
                else:
                    yield from walk(inner)
        elif isinstance(value, list):
            for inner in value:
                yield from walk(inner)

    for piece in walk(json.loads(text)):
        yield text.count("\n", 0, max(0, text.find(piece[:30]))) + 1, piece, False


def parts(name):
    """What people read in a file, as (line, text, whether it is a name)."""
    path = ROOT / name
    suffix = path.suffix if path.name != "CMakeLists.txt" else ".cmake"
    if suffix not in CODE | HASH | {".md", ".py", ".json"}:
        return
    text = path.read_text(encoding="utf-8")
    if suffix in CODE:
        yield from _code_parts(text)
    elif suffix == ".py":
        yield from _python_parts(text)
    elif suffix == ".json":
        yield from _json_parts(text)
    else:  # pages, and files whose comments begin with #
        for i, line in enumerate(text.split("\n"), 1):
            yield i, line, False


def private_words(name):
    """Findings of a file, one line of text each."""
    found = []
    for line, text, is_name in parts(name):
        if name == ".github/CONTRIBUTING.md" and text.startswith("|"):
            continue  # the table of these words
        hidden = ALLOWED.sub(" ", text)
        if is_name and text in ALLOWED_NAMES:
            continue
        if is_name:
            pieces = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", hidden)
            words = [piece for piece in pieces if piece.lower() in NAME_PARTS]
        else:
            words = WORD.findall(hidden)
        found += [f"{name}:{line}: '{word}' in: {text.strip()}" for word in words]
    return found


# ------------------------------------------------------------------------------ long sentences


def _blocks(text):
    """Paragraphs, list items, headings and table cells of a Markdown page: (line, text)."""
    block, begin, fenced = [], 0, False
    for i, line in enumerate([*text.split("\n"), ""], 1):
        bare = line.strip()
        if bare.startswith("```"):
            fenced = not fenced
        starts = bare.startswith(("#", "|", "* ", "- ", "> ", "```")) or re.match(r"\d+\. ", bare)
        is_code = fenced or bare.startswith("```") or (line.startswith("    ") and not block)
        if block and (not bare or starts or is_code):
            yield begin, " ".join(block)
            block = []
        if is_code or not bare:
            continue
        if bare.startswith("|"):
            for cell in re.split(r"[|;]", re.sub(r"`[^`]*`", "Code", bare)):
                yield i, cell  # a semicolon separates the items of a list
            continue
        if not block:
            begin = i
        block.append(re.sub(r"^(#+|[*>-]|\d+\.) +", "", bare))


def sentences(text):
    """Sentences of a Markdown page, as (line, sentence)."""
    for line, block in _blocks(text):
        if re.match(r"\[[A-Z]\w*\][^(]", block):
            continue  # a list of references
        bare = re.sub(r"`[^`]*`", "Code", block)
        bare = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", bare)
        bare = re.sub(r"\b(e\.g|i\.e|vs|no|cf|Fig|Eq)\.", r"\1", bare)
        for sentence in re.split(r"(?<=[.!?])[*_)\"]*\s+(?=[\"(*_\[]*[A-Z0-9<]|dockloop)", bare):
            yield line, sentence.strip()


def count_words(sentence):
    """Number of words; formulas and numbers count as one each."""
    return sum(any(c.isalnum() for c in word) for word in sentence.split())


def long_sentences(name):
    """Findings of a page, one line of text each."""
    text = (ROOT / name).read_text(encoding="utf-8")
    return [
        f"{name}:{line}: {count_words(sentence)} words: {sentence}"
        for line, sentence in sentences(text)
        if count_words(sentence) > LONGEST_SENTENCE
    ]


# --------------------------------------------------------------------------------------- tests


def test_sentences_of_pages_are_short():
    pages = [name for name in files() if name.endswith(".md")]
    assert pages
    found = [finding for name in pages for finding in long_sentences(name)]
    assert not found, "\n".join(found)


def test_private_words_do_not_occur():
    found = [finding for name in files() for finding in private_words(name)]
    assert not found, "\n".join(found)


def test_a_long_sentence_is_found_and_code_counts_as_one_word(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        f"{'word ' * 26}.\n\n* {'word ' * 24}`a b c d`. Next one.\n\n```\n{'code ' * 40}\n```\n"
    )
    found = [count_words(s) for _, s in sentences(page.read_text())]
    assert found == [26, 25, 2]


def test_private_words_are_found_in_comments_messages_and_names(tmp_path):
    code = tmp_path / "code.cpp"
    code.write_text('int kToldLate;  // the host is told\nconst char* text = "no trouble";\n')
    assert [line.split("'")[1] for line in private_words(str(code))] == ["Told", "told", "trouble"]
    script = tmp_path / "script.py"
    script.write_text('NO_LEAP = 1\ndef find_leap():\n    """Ask somebody."""\n')
    found = [line.split("'")[1] for line in private_words(str(script))]
    assert found == ["LEAP", "leap", "somebody"]


if __name__ == "__main__":
    names = sys.argv[1:] or list(files())
    lines = [line for name in names for line in private_words(name)]
    lines += [line for name in names if name.endswith(".md") for line in long_sentences(name)]
    print("\n".join(lines))
    sys.exit(bool(lines))
