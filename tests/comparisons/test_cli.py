"""The command line: status, one line for whoever can mend it, nothing heavy before it is needed."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from comparisons import cli
from ident.errors import InputError

HEAVY = {"pinocchio", "casadi", "numba", "cvxpy", "pyarrow", "matplotlib", "torch", "mujoco", "scipy", "pandas"}


def run(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as exit_:
        cli.main(words)
    captured = capsys.readouterr()
    return int(exit_.value.code or 0), captured.out, captured.err


@pytest.fixture
def break_doctor(monkeypatch: pytest.MonkeyPatch) -> Callable[[BaseException], None]:
    """Make the command doctor raise."""

    def arrange(error: BaseException) -> None:
        def doctor() -> None:
            raise error

        monkeypatch.setattr("comparisons.commands.doctor.doctor", doctor)

    return arrange


def test_help_names_every_command(capsys):
    status, out, err = run(capsys, "--help")
    assert (status, err) == (0, "")
    assert all(name in out for name in cli.COMMANDS)


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_every_command_explains_itself(capsys, command):
    status, out, _ = run(capsys, command, "--help")
    assert status == 0
    assert f"Usage: sensorless {command}" in out
    assert cli.COMMANDS[command].split(",")[0].rstrip(".") in " ".join(out.split())


def test_help_and_version_import_nothing_heavy():
    code = f"""
import sys
from comparisons.cli import main
for word in ("--help", "--version", "nonsense"):
    try:
        main([word])
    except SystemExit:
        pass
print(sorted({HEAVY!r} & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize(
    "words",
    [
        ["nonsense"],
        ["doctr"],
        ["--nonsense"],
        ["convert"],
        ["convert", "vs060", "a.csv"],
        ["convert", "vs060", "a.csv", "b.csv", "c.csv"],
        ["convert", "vs060", "a.csv", "b.csv", "--start", "soon"],
        ["convert", "vs060", "a.csv", "b.csv", "--nonsense", "1"],
        ["convert", "nobody", "a.csv", "b.csv"],
        ["doctor", "who"],
    ],
)
def test_a_wrong_call_is_one_line_and_status_2(capsys, words):
    status, out, err = run(capsys, *words)
    assert status == 2
    assert out == ""
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert err.count(", ") >= 2


def test_a_misspelt_command_is_recognised(capsys):
    assert "did you mean doctor?" in run(capsys, "doctr")[2]


def test_input_error_keeps_to_one_line(capsys, break_doctor):
    break_doctor(InputError("no\nrows", "log a", "give some"))
    assert run(capsys, "doctor")[0::2] == (2, "error: no rows, log a, give some\n")


def test_a_fault_says_how_to_get_its_traceback(capsys, break_doctor, monkeypatch):
    monkeypatch.delenv(cli.DEBUG, raising=False)
    break_doctor(ZeroDivisionError("by\nzero"))
    status, _, err = run(capsys, "doctor")
    assert status == 1
    assert err.startswith("fault of the program: ZeroDivisionError: by zero;")
    assert cli.DEBUG in err
    assert "Traceback" not in err


def test_debug_prints_the_traceback(capsys, break_doctor, monkeypatch):
    monkeypatch.setenv(cli.DEBUG, "1")
    break_doctor(ZeroDivisionError("by zero"))
    status, _, err = run(capsys, "doctor")
    assert status == 1
    assert err.startswith("Traceback")
    assert "test_cli.py" in err


def test_an_interrupt_is_130(capsys, break_doctor):
    break_doctor(KeyboardInterrupt())
    assert run(capsys, "doctor")[0::2] == (130, "interrupted\n")


def test_a_terminated_run_cleans_up(tmp_path):
    code = f"""
import os, signal, comparisons.commands.doctor as module
from comparisons.cli import main
from comparisons.output import OutputDirectory
def doctor():
    with OutputDirectory({str(tmp_path / "out")!r}, "doctor") as output:
        (output.path / "half.txt").write_text("half")
        os.kill(os.getpid(), signal.SIGTERM)
module.doctor = doctor
main(["doctor"])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 128 + signal.SIGTERM
    assert list(tmp_path.iterdir()) == []


def test_a_reader_that_leaves_early_is_no_fault():
    code = "from comparisons.cli import main; main(['--help'])"
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run([sys.executable, "-c", code], stdout=write, stderr=subprocess.PIPE, text=True, check=False)
    os.close(write)
    assert done.stderr == ""


def test_doctor_finds_the_program_well(capsys):
    status, out, _ = run(capsys, "doctor")
    assert status == 0
    assert out.splitlines()[-1] == "all is well"
    assert not [line for line in out.splitlines() if line.startswith("failed")]
    assert {line.split()[1] for line in out.splitlines() if line.startswith("ok")} >= {"numpy", "pin", "dynamics"}


def test_doctor_finds_wrong_dynamics(capsys, monkeypatch):
    from ident.multibody import Multibody

    monkeypatch.setattr(Multibody, "inverse_dynamics", lambda self, q, dq, ddq: q + 1.0)
    status, out, _ = run(capsys, "doctor")
    assert status == 1
    assert [line for line in out.splitlines() if line.startswith("failed  dynamics")]


def test_convert_writes_the_contract(capsys, tmp_path: Path):
    source = tmp_path / "a.csv"
    header = ",".join(["t", *(f"q{j}" for j in range(1, 7)), *(f"i{j}" for j in range(1, 7))])
    source.write_text(header + "\n" + "\n".join(f"{k / 100}" + f",{k / 1000}" * 12 for k in range(50)) + "\n")
    status, out, err = run(capsys, "convert", "vs060", str(source), str(tmp_path / "b.parquet"))
    assert (status, err) == (0, "")
    assert out == f"{tmp_path / 'b.parquet'}: 50 rows\n"
    assert (tmp_path / "b.parquet").stat().st_size > 0


def test_a_module_called_by_itself_ends_as_the_commands_do(monkeypatch, capsys):
    def count(*, jobs: int = 1) -> None:
        if jobs == 0:
            raise InputError("no process at all", "--jobs 0", "give how many")

    for words, status, said in (
        (["--jobs", "2"], 0, ""),
        (["--jobs", "0"], 2, "error: no process at all, --jobs 0, give how many\n"),
        (["--jobs", "two"], 2, "error: "),
    ):
        monkeypatch.setattr("sys.argv", ["count", *words])
        with pytest.raises(SystemExit) as left:
            cli.run_alone(count)
        err = capsys.readouterr().err
        assert (left.value.code, err.count("\n")) == (status, int(status > 0))
        assert err.startswith(said)
