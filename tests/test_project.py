"""What the project says of itself is true: pins, versions, the commands that README names, links, portability."""

import importlib.metadata
import re
import subprocess
import tomllib
from pathlib import Path

import pytest

from comparisons.cli import COMMANDS

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *sorted(ROOT.glob("docs/**/*.md"))]


def canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def requirement(line: str) -> str:
    found = re.match(r"[\w.-]+", line)
    assert found
    return canonical(found[0])


def pins() -> dict[str, str]:
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    exact = [re.fullmatch(r"([\w.-]+)==([^;\s]+)(; .*)?", line) for line in lines if line and not line.startswith("#")]
    assert None not in exact, "every line pins one version"
    return {canonical(pin[1]): pin[2] for pin in exact if pin}


def tracked() -> list[Path]:
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    names = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return [ROOT / name for name in names.split("\0") if name and (ROOT / name).is_file()]


def test_every_requirement_is_pinned():
    extras = PROJECT["optional-dependencies"].values()
    wanted = {requirement(line) for lines in [PROJECT["dependencies"], *extras] for line in lines}
    assert wanted - pins().keys() == set()


def test_what_requirements_bring_is_pinned_too():
    def brought(name: str) -> set[str]:
        try:
            lines = importlib.metadata.requires(name) or []
        except importlib.metadata.PackageNotFoundError:
            return set()
        # Requirements with a marker are those of extras, or of other machines than this one.
        return {requirement(line) for line in lines if ";" not in line}

    seen: set[str] = set()
    left = {requirement(line) for line in PROJECT["dependencies"]}
    while left:
        name = left.pop()
        seen.add(name)
        left |= brought(name) - seen
    assert len(seen) > len(PROJECT["dependencies"])
    # setuptools comes with the environment itself.
    assert seen - pins().keys() - {"setuptools"} == set()


def test_pins_fit_every_machine():
    assert [name for name, version in pins().items() if "+" in version] == []
    assert [name for name in pins() if name.startswith(("nvidia-", "cuda-")) or name == "triton"] == []


def test_version_is_the_same_everywhere():
    assert importlib.metadata.version("sensorless") == PROJECT["version"]
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    released = re.findall(r"^## \[(\d[^\]]*)\]", changes, re.MULTILINE)
    assert "## [Unreleased]" in changes
    assert released == [] or released[0] == PROJECT["version"]


def test_licence_is_what_the_metadata_says():
    assert PROJECT["license"] == "Apache-2.0"
    licence = (ROOT / "LICENSE").read_text(encoding="utf-8")
    assert "Apache License" in licence
    assert "END OF TERMS AND CONDITIONS" in licence


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_commands_that_pages_name_exist(page):
    code = re.findall(r"```sh\n(.*?)```|`([^`\n]+)`", page.read_text(encoding="utf-8"), re.DOTALL)
    lines = [line.strip() for block, inline in code for line in (block or inline).splitlines()]
    for line in lines:
        if target := re.match(r"make (\w+)(?:\s|$)", line):
            assert re.search(rf"^{target[1]}:", MAKEFILE, re.MULTILINE), line
        if command := re.match(r"(?:\.venv/bin/)?sensorless ([a-z]\w*)", line):
            assert command[1] in COMMANDS, line


def test_readme_names_every_command_and_the_test_command():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert [name for name in COMMANDS if f"`sensorless {name}" not in readme] == []
    assert "make test" in readme
    assert "make test" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_between_files_resolve(page):
    targets = re.findall(r"\]\(([^)\s#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8"))
    local = [target for target in targets if not target.startswith(("https://", "http://", "mailto:"))]
    assert [target for target in local if not (page.parent / target).exists()] == []


def test_ci_script_runs():
    script = ROOT / ".ci" / "run"
    assert script.stat().st_mode & 0o111
    subprocess.run(["bash", "-n", script], check=True)


def test_no_file_names_a_machine_or_a_package_index():
    # Put together here, so that this file does not name them itself.
    homes = [f"/{folder}/" for folder in ("root", "home", "Users", "work", "opt")]
    hosts = [f"{host}.org" for host in ("pypi", "pythonhosted", "download.pytorch")]
    found = []
    for path in tracked():
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            continue
        found += [f"{path.relative_to(ROOT)}: {word}" for word in homes if re.search(rf"(?<![\w.~-]){word}\w", text)]
        found += [f"{path.relative_to(ROOT)}: {word}" for word in hosts if word in text]
    assert found == []
