"""What the documentation says is true: names, arguments, links, commands, code, sources."""

import ast
import contextlib
import importlib
import io
import itertools
import re
import tomllib
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from comparisons.cli import COMMANDS, main
from ident.card import RobotCard
from ident.log import JointLog
from ident.log_writer import write_log
from ident.robot import load_robot

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
README = ROOT / "README.md"
PAGES = [README, *sorted(p for p in DOCS.rglob("*.md") if "_build" not in p.parts and "jupyter_execute" not in p.parts)]
API = (DOCS / "reference" / "api.md").read_text(encoding="utf-8")
OUTSIDE, INSIDE = (re.findall(r"automodule:: (\S+)", part) for part in API.split("\n## Inside\n"))
PACKAGES = (
    "ident", "ident.effects", "ident.gap", "observers", "learned", "comparisons.virtual_robot",
    "comparisons.protocols", "comparisons.report",
)  # fmt: skip
"""Packages whose ``__all__`` is meant to be imported from."""


def named(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def source_of(module: str) -> Path:
    path = ROOT.joinpath(*module.split("."))
    return path.with_suffix(".py") if path.with_suffix(".py").is_file() else path / "__init__.py"


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def public(module: str) -> list[ast.FunctionDef | ast.ClassDef]:
    nodes = parsed(source_of(module)).body
    return [n for n in nodes if isinstance(n, (ast.FunctionDef, ast.ClassDef)) and not n.name.startswith("_")]


def constants(module: str) -> list[str]:
    """Names that a module assigns and describes in the string below."""
    found = []
    nodes = parsed(source_of(module)).body
    for node, after in itertools.pairwise(nodes):
        described = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
        if described and isinstance(node, (ast.Assign, ast.AnnAssign)):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found += [target.id for target in targets if isinstance(target, ast.Name)]
    return found


def arguments(node: ast.FunctionDef | ast.ClassDef) -> tuple[str, list[str]]:
    """Heading of the section that documents what a function or class takes, and the names that belong there."""
    if isinstance(node, ast.ClassDef):
        makers = [n for n in node.body if isinstance(n, ast.FunctionDef) and n.name == "__init__"]
        if not makers:
            if not any("dataclass" in ast.unparse(d) for d in node.decorator_list):
                return "", []
            fields = [n for n in node.body if isinstance(n, ast.AnnAssign) and isinstance(n.target, ast.Name)]
            names = [n.target.id for n in fields if "ClassVar" not in ast.unparse(n.annotation)]
            return "Attributes", [name for name in names if not name.startswith("_")]
        node = makers[0]
    given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    names = [a.arg for a in given if a.arg not in ("self", "cls")]
    return "Args", names + [a.arg for a in (node.args.vararg, node.args.kwarg) if a is not None]


def section(docstring: str, heading: str) -> str:
    found = re.search(rf"^{heading}:\n((?:[ \t].*\n?|\n)*)", docstring, re.MULTILINE)
    return found[1] if found else ""


def test_the_reference_lists_modules_that_exist_once():
    assert [m for m in (*OUTSIDE, *INSIDE) if not source_of(m).is_file()] == []
    assert len({*OUTSIDE, *INSIDE}) == len(OUTSIDE) + len(INSIDE)


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_name_is_in_the_reference(package):
    listed = {node.name for module in OUTSIDE for node in public(module)}
    listed |= {name for module in OUTSIDE for name in constants(module)}
    listed |= {path.rpartition(".")[2] for path in re.findall(r"autofunction:: (\S+)", API)}
    assert [name for name in importlib.import_module(package).__all__ if name not in listed] == []


@pytest.mark.parametrize("module", OUTSIDE)
def test_every_public_function_and_class_documents_its_arguments(module):
    lacking = []
    for node in public(module):
        docstring = ast.get_docstring(node) or ""
        heading, names = arguments(node)
        # small records describe their fields in a sentence
        where = section(docstring, "Args") + section(docstring, "Attributes") if heading == "Args" else docstring
        missing = [name for name in names if not re.search(rf"\b{name}\b", where)]
        if not docstring or missing:
            lacking.append(f"{node.name}: {heading} {missing}")
    assert lacking == []


@pytest.mark.parametrize("module", [*OUTSIDE, *INSIDE])
def test_everything_in_the_reference_has_a_docstring(module):
    assert ast.get_docstring(parsed(source_of(module)))
    silent = [node.name for node in public(module) if not ast.get_docstring(node)]
    for node in public(module):
        methods = [n for n in node.body if isinstance(n, ast.FunctionDef)] if isinstance(node, ast.ClassDef) else []
        silent += [f"{node.name}.{m.name}" for m in methods if not m.name.startswith("_") and not ast.get_docstring(m)]
    assert silent == []


def headings(page: Path) -> set[str]:
    """Anchors of a page's headings, as MyST and GitHub make them."""
    text = re.sub(r"^(`{3,}).*?^\1", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    titles = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).strip().replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_links_resolve(page):
    text = re.sub(r"^(`{3,}).*?^\1", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    broken = []
    for target, anchor in re.findall(r"\]\(([^)\s#]*)(?:#([^)\s]*))?\)", text):
        if target.startswith(("https://", "http://", "mailto:")):
            continue
        path = (page.parent / target).resolve() if target else page
        if not path.exists() or (anchor and anchor not in headings(path)):
            broken.append(f"{target}#{anchor}")
    assert broken == []


@pytest.mark.parametrize("folder", [p.parent for p in sorted(DOCS.rglob("index.md"))], ids=lambda p: p.name)
def test_every_page_is_in_a_table_of_contents(folder):
    listed = re.findall(r"```\{toctree\}\n(.*?)```", (folder / "index.md").read_text(encoding="utf-8"), re.DOTALL)
    names = {line.strip() for block in listed for line in block.splitlines() if line.strip() and line[0] != ":"}
    own = {p.stem for p in folder.glob("*.md")} - {"index"}
    assert own - names == set()


def shell_lines(page: Path) -> list[str]:
    """Commands in the page's shell blocks and cells, continued lines joined, comments gone."""
    text = page.read_text(encoding="utf-8")
    blocks = re.findall(r"^ *```sh\n(.*?)^ *```", text, re.DOTALL | re.MULTILINE)
    blocks += re.findall(r"%%shell\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    lines = "\n".join(blocks).replace("\\\n", " ").splitlines()
    return [line.split(" #")[0].strip() for line in lines if line.strip()]


@cache
def help_of(command: str) -> str:
    said = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(said):
        patch.setenv("COLUMNS", "200")
        with pytest.raises(SystemExit, match="0"):
            main([command, "--help"])
    return said.getvalue()


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_commands_have_the_options_that_pages_give_them(page):
    wrong = []
    for line in shell_lines(page):
        for command, rest in re.findall(r"(?:^|[\s/])sensorless (\w+)\b([^|&;]*)", line):
            if command not in COMMANDS:
                wrong.append(line)
                continue
            shown = help_of(command)
            options = re.findall(r"(?<!\S)(--[\w-]+)", rest)
            wrong += [f"{command} {o}" for o in options if not re.search(rf"(?<![\w-]){o}(?![\w-])", shown)]
    assert wrong == []


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_scripts_have_the_options_that_pages_give_them(page):
    text = " ".join(page.read_text(encoding="utf-8").replace("\\\n", " ").split())
    wrong = []
    for script, rest in re.findall(r"python (?:-m )?(comparisons[\w.]+|benchmarks/\w+\.py)([^`]*)", text):
        path = ROOT / script if script.endswith(".py") else source_of(script)
        source = path.read_text(encoding="utf-8") if path.is_file() else ""
        options = re.findall(r"(?<!\S)--([a-z][\w-]*)", rest)
        wrong += [f"{script} --{o}" for o in options if not re.search(rf"\b{o}\b|\b{o.replace('-', '_')}\b", source)]
        wrong += [] if source else [script]
    assert wrong == []


def python_blocks(page: Path) -> list[str]:
    """Code of the page's Python blocks and cells, without magics."""
    text = page.read_text(encoding="utf-8")
    blocks = re.findall(r"^```(?:python|\{code-cell\} python)\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    return [re.sub(r"\A(?:---\n.*?---\n|:\w.*\n)*\n*", "", b, flags=re.DOTALL) for b in blocks if "%%" not in b]


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_python_on_pages_imports_names_that_exist(page):
    missing = []
    for block in python_blocks(page):
        for node in ast.walk(ast.parse(block)):
            own = isinstance(node, ast.ImportFrom) and str(node.module).split(".")[0] in (*PACKAGES, "comparisons")
            if own:
                module = importlib.import_module(str(node.module))
                missing += [f"{node.module}.{a.name}" for a in node.names if not exists(module, a.name)]
    assert missing == []


def exists(module, name: str) -> bool:
    if hasattr(module, name):
        return True
    return source_of(f"{module.__name__}.{name}").is_file()


ARM = """<robot name="arm"><link name="base"/>
<link name="upper"><inertial><origin xyz=".25 0 0"/><mass value="4"/>
<inertia ixx=".02" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz=".2 0 0"/><mass value="2"/>
<inertia ixx=".01" iyy=".05" izz=".05" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-2.5" upper="2.5" velocity="3" effort="90"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz=".5 0 0"/><axis xyz="0 1 0"/>
<limit lower="-2.5" upper="2.5" velocity="3" effort="50"/></joint></robot>"""


def recorded(robot, seed: int) -> JointLog:
    """Twenty seconds of the arm with Coulomb friction."""
    rng = np.random.default_rng(seed)
    t = np.arange(2000) / 100.0
    w, phase = rng.uniform(0.5, 3.0, (3, 1, 2)), rng.uniform(0.0, 6.0, (3, 1, 2))
    turn = w * t[:, None] + phase
    q, dq, ddq = (f.sum(axis=0) for f in (0.4 * np.sin(turn), 0.4 * w * np.cos(turn), -0.4 * w**2 * np.sin(turn)))
    torque = robot.rigid_body.inverse_dynamics(q, dq, ddq, np.tile(robot.multibody.parameters, (2, 1)))
    torque += np.tanh(dq / 1e-2) + 0.05 * rng.standard_normal(q.shape)
    return JointLog(t=t, q=q, current=torque / 10.0, name=f"log{seed}")


def test_python_of_the_readme_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("ur10.urdf").write_text(ARM)
    Path("robot.toml").write_text('name = "arm"\nurdf = "ur10.urdf"\ncurrent_unit = "A"\n')
    Path("logs").mkdir()
    robot = load_robot("robot.toml")
    for name, seed in (("train_1", 1), ("test", 2)):
        write_log(recorded(robot, seed), Path(f"logs/{name}.csv"))
    found: dict[str, object] = {}
    blocks = python_blocks(README)
    assert blocks
    for block in blocks:
        exec(block, found)
    outside = found["outside"]
    assert isinstance(outside, np.ndarray)
    # nobody touched the arm
    assert np.sqrt(np.mean(outside[100:-100] ** 2)) < 0.02
    assert "row1." in capsys.readouterr().out


def test_card_of_the_readme_is_one():
    block = re.search(r"```toml\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    assert block
    card = RobotCard.model_validate(tomllib.loads(block[1]))
    assert card.name == "ur10"


def test_every_source_that_a_docstring_names_is_under_citations():
    lines = (DOCS / "reference" / "citations.md").read_text(encoding="utf-8").splitlines()
    missing = []
    code = [p for package in ("ident", "observers", "learned", "comparisons") for p in (ROOT / package).rglob("*.py")]
    for path in sorted(code):
        nodes = [n for n in ast.walk(parsed(path)) if isinstance(n, (ast.Module, ast.ClassDef, ast.FunctionDef))]
        named_there = [one for node in nodes for one in sources(ast.get_docstring(node) or "")]
        missing += [f"{path.name}: {one}" for one in named_there if not told(one, lines)]
    assert missing == []


def sources(docstring: str) -> list[tuple[str, str]]:
    """Authors and years that a docstring names, as in ``Gautier and Briot 2014`` or ``Kaufman's (1975)``."""
    text = " ".join(docstring.split())
    name = r"[A-Z][\w-]+(?: [A-Z][\w-]+)?"
    pattern = rf"({name})(?:'s?)?(?:, {name})*(?: and {name}| et al\.)?,? \(?((?:19|20)\d\d)\b"
    return re.findall(pattern, text)


def told(source: tuple[str, str], lines: list[str]) -> bool:
    author, year = source
    return any(author.split()[-1] in line and year in line for line in lines)
