"""docs/mutants.md lists all parts of the package and of libraries that tests replace, and what this hides."""
import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
REPLACING = {'setattr', 'delattr', 'setitem', 'delitem', 'object'}


def name_of(argument):
    """Return the last part of a name that is given as a string, or * for a name that is computed."""
    return argument.value.rpartition('.')[2] if isinstance(argument, ast.Constant) else '*'


def replaced(code):
    """Yield the names that a test module replaces in any call of ``monkeypatch`` or ``patch``."""
    for node in ast.walk(ast.parse(code)):
        if (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in REPLACING
                and len(node.args) > 1):
            first, second = node.args[:2]
            yield name_of(first if isinstance(first, ast.Constant) else second)


def test_replaced_names_are_found_in_every_form_of_the_call():
    code = ("monkeypatch.setattr(a, 'b', 1)\npatch.setattr('c.d', 1)\npatch.object(a, 'e', 1)\n"
            "monkeypatch.delattr(a, 'f')\nmonkeypatch.setitem(a, 'g', None)\nmonkeypatch.setattr(a, name, 1)\n")
    assert [*replaced(code)] == ['b', 'd', 'e', 'f', 'g', '*']


def test_every_replaced_name_stands_in_the_list_of_its_file():
    codes = {str(path.relative_to(ROOT / 'test')): path.read_text() for path in (ROOT / 'test').rglob('*.py')
             if path.name != Path(__file__).name}
    found = {name: set(replaced(code)) for name, code in codes.items()
             if any(f'.{word}(' in code for word in REPLACING)}
    _, _, listed = (ROOT / 'docs' / 'mutants.md').read_text().partition('## What tests replace')
    rows = re.findall(r'^\| `(\S+\.py)` \| (.+?) \| .+ \|$', listed, re.MULTILINE)
    assert {name: set(re.findall('`(.+?)`', names)) for name, names in rows} == {
        name: names for name, names in found.items() if names}
