"""The API reference is complete and agrees with the docstrings."""

from tests.helpers.api_reference import REFERENCE


def test_the_pages_agree_with_the_docstrings():
    made = REFERENCE.pages()
    kept = {file.name: file.read_text(encoding="utf-8") for file in REFERENCE.FOLDER.glob("*.md")}
    stale = sorted(name for name in made.keys() | kept.keys() if made.get(name) != kept.get(name))
    assert not stale, f"run: python docs/api_reference.py (stale: {', '.join(stale)})"


def test_every_public_name_has_its_entry_and_its_line_in_the_index():
    index = (REFERENCE.FOLDER / "README.md").read_text(encoding="utf-8")
    names = [(module, name) for module in REFERENCE.MODULES for name in REFERENCE.members(module)]
    for module, name in names:
        page = (REFERENCE.FOLDER / f"{module}.md").read_text(encoding="utf-8")
        assert f"\n## {name}\n" in page
        assert f"]({module}.md#{name.lower()})" in index
    assert len(names) > 100
