"""Reports in a headless Chromium: no console error, no broken picture, no request to the network."""

import html
import json
import re
import shutil
import socket
import subprocess
import threading

import numpy as np
import pytest

from comparisons.experiments.compliant import Ride
from comparisons.report import Report
from comparisons.report.compliance_figures import joint_compliance, task_compliance
from comparisons.report.provenance import provenance
from comparisons.report.style import new_figure
from comparisons.virtual_robot.contact import Push
from ident.log import JointLog
from ident.robot import load_robot

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
QUIET = (
    "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-default-apps", "--disable-sync", "--metrics-recording-only",
    "--enable-logging=stderr", "--dump-dom",
)  # fmt: skip
PROBE = """<script>
// Copies of the pictures in drawings, which tell no one whether they are whole; the page is not loaded until they are.
const copies = [];
document.addEventListener("DOMContentLoaded", () => {
  for (const picture of document.querySelectorAll("svg image")) {
    const copy = new Image();
    copy.src = picture.href.baseVal;
    copies.push(copy);
  }
});
window.addEventListener("load", () => {
  const whole = picture => picture.complete && picture.naturalWidth > 0;
  const pictures = [...document.querySelectorAll("img"), ...copies];
  const broken = pictures.filter(picture => !whole(picture)).map(picture => picture.src.slice(0, 60));
  for (const drawing of document.querySelectorAll("figure svg"))
    if (drawing.getBoundingClientRect().height < 20) broken.push("flat drawing");
  const fetched = performance.getEntriesByType("resource").map(one => one.name).filter(n => !n.startsWith("data:"));
  document.title = JSON.stringify({broken, fetched, drawings: document.querySelectorAll("figure svg").length,
    pictures: copies.length});
});
</script>"""

pytestmark = pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine")


class Ear:
    """A proxy that answers nobody and notes the hosts it is asked for."""

    def __enter__(self):
        self.asked: list[str] = []
        self.server = socket.create_server(("127.0.0.1", 0))
        threading.Thread(target=self._listen, daemon=True).start()
        return self

    def __exit__(self, *failure):
        self.server.close()

    def _listen(self):
        while True:
            try:
                caller, _ = self.server.accept()
            except OSError:
                return
            with caller:
                self.asked.append(caller.recv(4096).decode(errors="replace").split("\r\n")[0])

    @property
    def port(self):
        return self.server.getsockname()[1]


def opened(path, folder):
    """What the probe and the console say of a page, and which hosts the browser asked for."""
    page = path.read_text(encoding="utf-8")
    probed = folder / "probed.html"
    probed.write_text(page.replace("</head>", f"{PROBE}</head>", 1), encoding="utf-8")
    with Ear() as ear:
        done = subprocess.run(
            [BROWSER, *QUIET, f"--proxy-server=127.0.0.1:{ear.port}", "--proxy-bypass-list=<-loopback>",
             f"--user-data-dir={folder / 'profile'}", probed.as_uri()],
            capture_output=True, text=True, timeout=120, check=True,
        )  # fmt: skip
    console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    (title,) = re.findall(r"<title>(\{.*?\})</title>", done.stdout)
    # the browser itself may ask its maker's servers for updates, whatever it is told
    asked = [line for line in ear.asked if not re.search(r"google|gstatic|chromium", line)]
    return json.loads(html.unescape(title)), console, asked


@pytest.fixture
def report(tmp_path):
    """A page with every kind of content, two figures of a compliant arm among it."""
    robot = load_robot("vs060")
    t = np.arange(0.0, 5.0, 0.01)
    q = np.zeros((len(t), 6))
    wrench = np.sin(t)[:, None] * np.ones(6)
    log = JointLog(t=t, q=q, current=q, tau_ext=q, wrench=wrench)
    joint = Ride(log, {"gmo": 5.0 * wrench, "hrdl-md": 4.0 * wrench}, 0.1 * wrench, t > 4.0)
    push = Push(3, (0.0, 0.0, 0.2), (30.0, 0.0, 0.0), 2.0, 1.0)
    cloud = new_figure()
    cloud.subplots().plot(*np.random.default_rng(0).normal(size=(2, 50_000)), ".")
    made = Report("Everything", "A `summary`.").section("Words").text("One.\n\nTwo.")
    made.table(["a", "b [A]"], [[1, 2.5], ["x", float("nan")]], "Numbers")
    made.section("Figures").figure(joint_compliance(robot, joint, np.full(6, 3.0), [push]), "Joints")
    made.figure(task_compliance(joint, np.ones(3)), "Task").figure(cloud, "Many points")
    made.provenance(provenance(seed=1, command=["sensorless", "x"])).write(tmp_path / "report.html")
    return tmp_path / "report.html"


def test_report_opens_without_error_picture_or_request_gone_wrong(report, tmp_path):
    told, console, asked = opened(report, tmp_path)
    assert told["broken"] == []
    assert told["fetched"] == []
    assert told["drawings"] == 3
    assert told["pictures"] >= 1
    assert console == []
    assert asked == []


def test_a_page_that_is_not_whole_would_be_found_out(report, tmp_path):
    """The check can fail: an error, two broken pictures and a script from elsewhere."""
    page = report.read_text(encoding="utf-8")
    wrong = (
        '<script>console.error("wrong")</script><script src="http://elsewhere.invalid/x.js"></script>'
        '<img src="data:image/png;base64,AAAA"><svg><image href="data:image/png;base64,AAAA"/></svg></body>'
    )
    report.write_text(page.replace("</body>", wrong), encoding="utf-8")
    told, console, asked = opened(report, tmp_path)
    assert len(told["broken"]) == 2
    assert told["fetched"] == ["http://elsewhere.invalid/x.js"]
    assert any("wrong" in line for line in console)
    assert any("elsewhere.invalid" in line for line in asked)
