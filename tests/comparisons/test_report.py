"""Reports: one offline file, safe text, tables that sort, figures that keep their peaks and stay light."""

import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from comparisons.report import Report
from comparisons.report.provenance import provenance
from comparisons.report.style import FAINT, INK, joint_grid, legend_above, new_figure, thin

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
VOID = {"meta", "link", "input", "br", "img"}


class Page(HTMLParser):
    """Collects ids, links and cells of a page and checks that its elements nest."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.outside: list[str] = []
        self.anchors: list[str] = []
        self.text = ""
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        if tag not in VOID:
            self.open.append(tag)
        values = dict(attributes)
        self.ids += [values["id"]] if "id" in values else []
        for key in ("src", "href", "xlink:href"):
            link = values.get(key) or "#"
            (self.anchors if link.startswith("#") else self.outside).append(link)

    def handle_startendtag(self, tag, attributes):
        if tag not in VOID:
            self.handle_starttag(tag, attributes)
            self.open.pop()
        else:
            self.handle_starttag(tag, attributes)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def written(report: Report, folder: Path) -> str:
    report.write(folder / "report.html")
    return (folder / "report.html").read_text(encoding="utf-8")


def full_report(inputs: tuple[Path, ...] = ()) -> Report:
    time = np.linspace(0.0, 6.0, 20_000)
    figure, axes = joint_grid(["shoulder", "elbow", "wrist"], "time [s]", "current [A]")
    for axis in axes:
        axis.plot(*thin(time, np.sin(time)), label="measured")
        axis.plot(time, np.cos(time), ".", label="predicted")
    legend_above(figure, axes[0])
    report = Report("Fit of <arm>", "Error `3 %`.").section("Fit").text("First.\n\nSecond `code` & <b>bold</b>.")
    report.table(["joint", "error [A]", "note"], [[1, 0.5, "b"], [2, float("nan"), "a"], [3, -12.25, None]], "Errors")
    report.figure(figure, "Currents").figure(figure, "Currents again")
    report.section("Parameters").table(["name"], [], "none")
    return report.provenance(
        provenance(inputs, seed=7, command=["sensorless", "identify", "a b"], libraries=["nobody"])
    )


def test_page_is_whole_and_needs_nothing_from_outside(tmp_path):
    page = Page(written(full_report(), tmp_path))
    assert [link for link in page.outside if not link.startswith("data:")] == []
    assert len(page.ids) == len(set(page.ids))
    assert {anchor[1:] for anchor in page.anchors if len(anchor) > 1} <= set(page.ids)


def test_page_says_what_it_was_given(tmp_path):
    text = Page(written(full_report(), tmp_path)).text
    for expected in [
        "Fit of <arm>",
        "<b>bold</b>",
        "Errors",
        "Joint 2: elbow",
        "Figure 2.",
        "sensorless identify 'a b'",
    ]:
        assert expected in text


def test_nothing_given_is_read_as_html(tmp_path):
    evil = "<script>evil()</script>"
    report = Report(evil, evil).section(evil).text(f"{evil} `{evil}`").table([evil], [[evil]], evil)
    figure = new_figure()
    figure.subplots().set_title(evil)
    page = written(report.figure(figure, evil), tmp_path)
    assert evil not in page
    assert Page(page).text.count(evil) >= 8


def test_numbers_line_up_and_carry_what_they_sort_by(tmp_path):
    page = written(full_report(), tmp_path)
    assert '<td class="number" data-number="0.5">0.5000</td>' in page
    assert '<td class="number" data-number="-12.25">−12.25</td>' in page
    assert '<td class="number">–</td>' in page
    assert "<td>b</td>" in page


def test_a_row_of_the_wrong_length_is_refused():
    with pytest.raises(ValueError, match="row 2 has 1 cells where there are 2 columns"):
        Report("r").section("s").table(["a", "b"], [[1, 2], [3]])


def test_content_needs_a_section():
    with pytest.raises(ValueError, match="section"):
        Report("r").text("lost")


def test_figures_take_the_colours_of_the_page(tmp_path):
    page = written(full_report(), tmp_path)
    assert "currentColor" in page
    figures = "".join(re.findall(r"<svg.*?</svg>", page, re.DOTALL))
    assert INK not in figures
    assert FAINT not in figures


def test_many_points_become_an_image(tmp_path):
    many, few = new_figure(), new_figure()
    points = np.random.default_rng(0).normal(size=(2, 50_000))
    many.subplots().plot(*points, ".")
    few.subplots().plot(*points[:, :100], ".")
    report = Report("r").section("s")
    assert "<image" not in written(report.figure(few), tmp_path)
    page = written(report.figure(many), tmp_path)
    assert "<image" in page
    assert len(page) < 500_000
    assert not many.axes[0].lines[0].get_rasterized()


def test_the_same_figure_gives_the_same_page(tmp_path):
    def page() -> str:
        figure, axes = joint_grid(["a", "b"], "x", "y")
        axes[0].plot([0, 1], [1, 0])
        return written(Report("r").section("s").figure(figure), tmp_path)

    assert page() == page()


@pytest.mark.parametrize("n", [1, 2, 3, 5, 6, 7])
def test_joint_grid_has_a_panel_a_joint_with_labels_at_the_foot(n):
    _, axes = joint_grid([f"j{k}" for k in range(n)], "time [s]", "current [A]", columns=3)
    assert [axis.get_title(loc="left") for axis in axes] == [f"Joint {k + 1}: j{k}" for k in range(n)]
    assert sum(axis.get_xlabel() == "time [s]" for axis in axes) == min(n, 3)
    assert all(axis.get_xlabel() for axis in axes[-min(n, 3) :])


def test_thin_keeps_peaks_order_and_gaps():
    t = np.arange(100_000.0)
    y = np.sin(t / 5000)
    y[12_345], y[54_321], y[77_000:78_000] = 9.0, -9.0, np.nan
    kept_t, kept_y = thin(t, y, points=1000)
    assert len(kept_t) <= 1100
    assert np.all(np.diff(kept_t) > 0)
    assert (np.nanmax(kept_y), np.nanmin(kept_y)) == (9.0, -9.0)
    assert np.isnan(kept_y).any()
    np.testing.assert_array_equal(thin(t[:10], y[:10])[1], y[:10])


def test_provenance_counts_inputs(tmp_path):
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "a").write_bytes(b"12345")
    (tmp_path / "log.csv").write_bytes(b"123")
    note = provenance([tmp_path / "bag", tmp_path / "log.csv"], seed=1)
    assert [size for _, size in note.inputs] == [5, 3]
    assert note.to_dict()["inputs"][1] == {"path": str(tmp_path / "log.csv"), "bytes": 3}
    assert {"sensorless", "python", "numpy", "pin"} <= set(note.versions)


@pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine")
def test_page_opens_in_a_browser_and_its_table_sorts(tmp_path):
    page = written(full_report(), tmp_path)
    # A click on the second column's title, then what the table shows is written where the browser dumps it.
    probe = """<script>
      document.querySelectorAll("th button")[1].click();
      document.title = [...document.querySelectorAll("tbody")[0].rows].map(row => row.cells[0].textContent).join();
    </script></body>"""
    (tmp_path / "report.html").write_text(page.replace("</body>", probe), encoding="utf-8")
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--dump-dom"]
    done = subprocess.run(
        [*command, f"--user-data-dir={tmp_path / 'profile'}", (tmp_path / "report.html").as_uri()],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert "<title>3,1,2</title>" in done.stdout
    assert [line for line in done.stderr.splitlines() if "CONSOLE" in line] == []
