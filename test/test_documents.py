"""README and docs: links, versions, names of files, length of sentences."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
LINK = re.compile(r"\]\((?!https?://)([^)#\s]*)(?:#([^)\s]+))?\)")


def prose(path: Path) -> str:
    """Return the text of a document without its code blocks."""
    return re.sub(r"^( *)```.*?^\1```$", "", path.read_text(), flags=re.MULTILINE | re.DOTALL)


def anchors(path: Path) -> set[str]:
    """Return the anchors that GitHub gives to the headings of a document."""
    headings = re.findall(r"^#+ (.*)$", prose(path), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_link_is_dead(document):
    for target, anchor in LINK.findall(prose(document)):
        file = (document.parent / target).resolve() if target else document
        assert file.exists(), target
        if anchor:
            assert anchor in anchors(file), f"{target}#{anchor}"


def test_documents_name_the_version_of_the_package():
    text = (ROOT / "package.xml").read_text()
    version = re.search(r"<version>(.*)</version>", text)
    assert version is not None
    assert f"Version {version[1]}." in (ROOT / "README.md").read_text()
    assert f"\n{version[1]} " in (ROOT / "CHANGELOG.rst").read_text()


MOST_WORDS = 30


def sentences(text: str) -> list[str]:
    """Return the sentences, without tables, headings and output of benchmarks."""
    text = re.sub(r"<!-- (\w+) -->.*?<!-- /\1 -->", "", text, flags=re.DOTALL)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r"^(\||#|!\[| {4}).*$", "", text, flags=re.MULTILINE)
    paragraphs = re.split(r"\n\s*\n|\n(?=\s*(?:[-*]|\d+\.) )", text)
    return [
        sentence
        for paragraph in paragraphs
        for sentence in re.split(r"(?<=[.!?:;])\s+", " ".join(paragraph.split()))
    ]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_sentences_are_short(document):
    assert [each for each in sentences(prose(document)) if len(each.split()) > MOST_WORDS] == []


FILE = re.compile(r"`((?:\w+/)+\w+\.(?:py|yaml|xacro|rviz|js|html|toml))`")


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_files_that_a_document_names_exist(document):
    for name in FILE.findall(prose(document)):
        if "NAME" in name:
            continue
        assert (ROOT / name).exists() or (ROOT / "head_tracking" / name).exists(), name


def test_the_tables_named_in_add_one_exist():
    text = (ROOT / "docs" / "explain" / "architecture.md").read_text()
    rows = text.partition("\n## Add one\n")[2].partition("\n## ")[0].splitlines()
    tables = [
        (name, file)
        for row in rows
        for names, file in re.findall(r"((?:`[A-Z]+`(?: and )?)+) in `([\w/]+\.py)`", row)
        for name in re.findall(r"[A-Z]+", names)
    ]
    assert len(tables) >= 3
    for name, file in tables:
        code = (ROOT / "head_tracking" / file).read_text()
        assert re.search(rf"^{name}\b.*=", code, re.MULTILINE), f"{name} in {file}"
