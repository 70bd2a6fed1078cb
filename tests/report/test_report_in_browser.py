"""The report of a hostile model in a real browser: nothing in it runs, loads or becomes an element."""

import json
import re
import threading
from collections import Counter
from collections.abc import Iterator
from html.parser import HTMLParser
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from browser import needs_browser, visited
from report.test_report import run_folder

from dl2c.env.opening import source_of
from dl2c.report.markup import POLICY
from dl2c.report.page import measure, report
from dl2c.report.trained import read_trained

pytest.importorskip("matplotlib")

pytestmark = needs_browser

OWNED = "document.title='owned'"
ATTACKS = (
    f"<script>{OWNED}</script>",
    f"><img src=x onerror={OWNED}>",
    f"'><svg onload={OWNED}>",
    f"</style><script>{OWNED}</script>",
    f"</title></pre></ol></table><iframe srcdoc=x></iframe><script>{OWNED}</script>",
    f"<!--><script>{OWNED}</script>-->",
    f"&#60;script&#62;{OWNED}&#60;/script&#62; &#x &lt;b&gt; &amp;amp;",
    "<![CDATA[<b>]]> {{7*7}} ${7*7} `id` %s {0} javascript:alert(1)",
    "<a href=javascript:alert(1) autofocus onfocus=alert(1)>x</a><base href=http://WHERE/>",
    "<link rel=stylesheet href=http://WHERE/a.css><img src=http://WHERE/b.png><object data=http://WHERE/c>",
)

TEXT = source_of("example:watertank").text


class Heard(ThreadingHTTPServer):
    """Counts what is asked for."""

    asked = 0


class Counts(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        assert isinstance(self.server, Heard)
        self.server.asked += 1
        self.send_error(404)

    def log_message(self, format: str, *args: object) -> None:
        pass


@pytest.fixture
def server() -> Iterator[Heard]:
    with Heard(("127.0.0.1", 0), Counts) as made:
        threading.Thread(target=made.serve_forever, daemon=True).start()
        yield made
        made.shutdown()


class Elements(HTMLParser):
    """How often an element is there, and with which attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: Counter[str] = Counter()
        self.attributes: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found[tag] += 1
        self.attributes |= {name for name, _ in attrs}


def opened(page: str, folder: Path) -> tuple[str, str]:
    """The document as it is after its scripts, if any, have run; and what the console said."""
    done = visited(page, folder, "--virtual-time-budget=2000", "--enable-logging=stderr", "--dump-dom")
    assert done.returncode == 0 and b"<body" in done.stdout, done.stderr[-2000:]
    lines = done.stderr.decode("utf-8", "replace").splitlines()
    return done.stdout.decode("utf-8", "replace"), "\n".join(line for line in lines if "CONSOLE" in line)


def hostile(text: str, place: str) -> str:
    """The water tank with a text wherever one may stand; quotes and ends of comments have to go there."""
    attack = text.replace("WHERE", place)
    quoted = attack.replace('"', "'").replace("\\", "")
    made = TEXT.replace('def="level"', f'def="{quoted}"').replace('unit="m/s"', f'unit="{quoted}"')
    made = made.replace('Theorem "Water tank"', f'Theorem "{quoted}"')
    return made.replace("/* Keep", f"/* {attack.replace('*/', '')} Keep") + f"\n// {attack}\n"


def page_of(text: str, folder: Path) -> str:
    """The report of a training on a model, with the text's first line as every word of the run."""
    folder.mkdir(parents=True)
    run_folder(folder, text)
    content = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    content["versions"] = {"dl2c": f"{text[-300:]}\u202e\u2066", "torch": text[-300:]}
    (folder / "run.json").write_text(json.dumps(content), encoding="utf-8")
    trained = read_trained(folder)
    return report(trained, measure(trained, 5))


def check(attacks: str, server: Heard, folder: Path) -> None:
    place = f"127.0.0.1:{server.server_address[1]}"
    page = page_of(hostile(attacks, place), folder / "<img src=x onerror=alert(1)>" / "run")
    plain = page_of(hostile("harmless", place), folder / "plain")
    unguarded = page.replace(POLICY, "")
    assert unguarded != page and ("owned" in page) == ("owned" in attacks) and "\u202e" not in page
    for name, text in {"guarded": page, "unguarded": unguarded}.items():
        document, said = opened(text, folder / name)
        assert said == ""
        seen, wanted = Elements(document), Elements(plain)
        assert set(seen.found) <= {*wanted.found, "tbody"} and seen.found["img"] == wanted.found["img"]
        assert not {a for a in seen.attributes if a.startswith("on")} and "srcdoc" not in seen.attributes
        title = re.search(r"<title>(.*?)</title>", document, re.DOTALL)
        assert title is not None and title[1].strip() != "owned"
    assert server.asked == 0


def test_a_browser_runs_what_is_not_escaped(server: Heard, tmp_path: Path) -> None:
    """Or else the other tests would say nothing."""
    place = f"127.0.0.1:{server.server_address[1]}"
    image = f"<img src='http://{place}/a.png'>"
    document, _ = opened(f"<title>mine</title>{ATTACKS[0]}{image}", tmp_path / "open")
    assert "<title>owned</title>" in document and server.asked > 0
    policy = f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
    document, said = opened(f"{policy}<title>mine</title>{ATTACKS[0]}{image}", tmp_path / "closed")
    assert "<title>mine</title>" in document and said


@pytest.mark.slow
def test_a_report_of_hostile_text_does_nothing(server: Heard, tmp_path: Path) -> None:
    check(" ".join(ATTACKS), server, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(ATTACKS)))
def test_each_attack_does_nothing(number: int, server: Heard, tmp_path: Path) -> None:
    check(ATTACKS[number], server, tmp_path)
