"""Sends requests to Nominatim and Overpass with osmnx: only to the configured hosts, in turn, and with limits.

osmnx makes the requests, identifies the program, and waits for a free slot at Overpass. The rest happens in a hook
(osmnx's setting ``requests_kwargs``), which the library ``requests`` calls with every response before reading its body.
Redirects are not followed. An answer is read only up to a limit in bytes and seconds. A refusal (429, 504 …) becomes an
exception with the service's retry time; osmnx would wait 55 s after each refusal, without end.
"""

import fcntl
import io
import socket
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from pathlib import Path
from typing import Any, Generic, TypeVar
from urllib.parse import urlsplit

from tenacity import RetryCallState, Retrying, retry_if_exception, stop_after_attempt

from ....schemas.errors import NotPossible, ServiceFailure
from ....schemas.maps import MapServices
from ....schemas.text import cited
from ...execution import ProgressReporter
from .answers import AnswerCache, KeptAnswer
from .messages import Finding, MapData, NotReadable, read_findings, read_map_data

_MIB = 1024**2
MOST_BYTES = 60 * _MIB
"""Maximum size of one answer (chosen): a larger map is not read either."""
CONNECT_S = 4.0
"""Maximum time to find and reach a host (chosen): without a network, the refusal comes at once."""
MOST_WAIT_S = 20.0
"""Maximum wait for a service before the next one is asked (chosen)."""
MOST_SECONDS = 120.0
"""Maximum time for all services together (chosen): users do not wait longer."""
ATTEMPTS = 2
"""Attempts at one service (the paper's: one retry each)."""
FIRST_PAUSE_S = 1.0
"""Pause before the second attempt if the service gives no time; doubled for each further one."""
EMPTY_KEPT_S = 3_600.0
"""An empty answer expires after this time (chosen): the place may have been mapped since."""
_MOST_STATUS_READS = 3
_MOST_SHARE = 0.8
_CHUNK = 64 * 1024
_LONGEST_REASON = 160
_UNKNOWN_PAUSE = -1.0
_AGAIN = frozenset({429, 500, 502, 503, 504})
"""Statuses after which the same request may succeed."""


class Trouble(Exception):
    """Raised if a service gave no valid answer; ``again``: a retry may succeed after ``wait_s`` seconds."""

    def __init__(self, what: str, *, again: bool = False, wait_s: float | None = None) -> None:
        super().__init__(what)
        self.again, self.wait_s = again, wait_s


_Read = TypeVar("_Read")


@dataclass(frozen=True)
class Answered(Generic[_Read]):
    """A validated answer, its host, and whether it was cached.

    ``troubles``: a sentence for each service that failed.
    """

    answer: _Read
    service: str
    kept: bool
    troubles: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Question(Generic[_Read]):
    """A query for online services of one kind, at addresses to try in order.

    ``ask`` sends it to the service at an address. ``read`` reads the answer or raises ``NotReadable``.
    ``is_sufficient`` returns whether an answer has content.
    """

    text: str
    kind: str
    urls: Sequence[str]
    ask: Callable[[str], object]
    read: Callable[[object], _Read]
    is_sufficient: Callable[[_Read], bool]


@dataclass
class _Guard:
    """Checks every response before it is read."""

    hosts: tuple[str, ...]
    deadline: float
    report_size: Callable[[int], None]
    status_reads: int = field(default=0)

    def __call__(self, response: Any, *unused: object, **options: object) -> None:
        """Read the body of a good response; raise an error for any other.

        Raises:
            Trouble: the response is a redirect, an error status, a page instead of data, too slow, or incomplete.
            NotPossible: the response is larger than the limit.
        """
        del unused, options
        try:
            self._look_at(response)
        except BaseException:
            response.close()
            raise

    def _look_at(self, response: Any) -> None:
        host = urlsplit(response.url).netloc.rpartition("@")[2]
        if host not in self.hosts:
            raise Trouble(f"{host} is not a configured host")
        if 300 <= response.status_code < 400:
            goal = urlsplit(response.headers.get("location", "")).netloc
            raise Trouble(f"redirects to {cited(goal)}, which is not followed")
        is_status = urlsplit(response.url).path.endswith("/status")
        self._count(is_status)
        if response.status_code != 200 and not is_status:
            raise self._refused(response)
        body = self._body(response)
        if not is_status and body.lstrip()[:1] == b"<":
            raise Trouble(f"answered with a page instead of data: {_text_of_page(body)}", again=True)
        response.raw = io.BytesIO(body)

    def _count(self, is_status: bool) -> None:
        """Limit status requests, since osmnx repeats them while all slots are taken."""
        self.status_reads += is_status
        if self.status_reads > _MOST_STATUS_READS:
            raise Trouble("its slots stay occupied")

    def _refused(self, response: Any) -> Trouble:
        text = _text_of_page(self._body(response))
        reason = {429: "asks to wait (429)", 504: "is too busy (504)"}.get(
            response.status_code, f"refuses ({response.status_code})"
        )
        wait_s = _retry_after_s(response.headers.get("retry-after", ""))
        return Trouble(f"{reason}{f': {text}' if text else ''}", again=response.status_code in _AGAIN, wait_s=wait_s)

    def _body(self, response: Any) -> bytes:
        from requests.exceptions import RequestException
        from urllib3.exceptions import HTTPError

        stated = response.headers.get("content-length", "")
        if stated.isdecimal() and int(stated) > MOST_BYTES:
            raise _too_much()
        parts: list[bytes] = []
        size = 0
        try:
            while part := response.raw.read1(_CHUNK, decode_content=True):  # bytes may arrive one by one
                size += len(part)
                if size > MOST_BYTES:
                    raise _too_much()
                if time.monotonic() > self.deadline:
                    raise Trouble("sends too slowly", again=False)
                parts.append(part)
                self.report_size(size)
        except (HTTPError, RequestException, OSError) as error:
            raise Trouble("broke off in the middle of its answer", again=True) from error
        finally:
            response.close()
        return b"".join(parts)


def _too_much() -> NotPossible:
    """Return the refusal of an answer that is too large; other services would send the same amount."""
    return NotPossible(
        f"the answer exceeds the limit of {MOST_BYTES // _MIB} MB of map data",
        next_step="choose a smaller bbox or a street of the place, or lower maps_km2",
        reason=TOO_LARGE,
    )


def _text_of_page(body: bytes) -> str:
    """Return the text of a page, without its tags."""
    from lxml import etree, html

    try:
        text = " ".join(str(part) for part in html.fromstring(body[:_CHUNK]).itertext()) if body.strip() else ""
    except (etree.LxmlError, ValueError):
        text = body[:_CHUNK].decode("utf-8", "replace")
    return cited(text, _LONGEST_REASON) if text.strip() else ""


def _retry_after_s(text: str) -> float | None:
    """Return seconds from a Retry-After header (a number or a date), or None."""
    if text.strip().isdecimal():
        return float(text)
    try:
        return max((parsedate_to_datetime(text) - datetime.now(UTC)).total_seconds(), 0.0)
    except (TypeError, ValueError):
        return None


class ServiceClient:
    """Asks Nominatim and Overpass, or returns their cached answers."""

    def __init__(self, services: MapServices, report: ProgressReporter) -> None:
        self._services, self._report, self._share = services, report, 0.05
        self._cache = AnswerCache(Path(services.cache), services.cache_mb, services.cache_days)
        self._reported_bytes = 0
        self._give_up_at = time.monotonic() + MOST_SECONDS

    def search(self, parameters: Mapping[str, int | str]) -> Answered[list[Finding]]:
        """Return Nominatim's results: a list of places in its format jsonv2.

        Raises:
            ServiceFailure: Nominatim cannot be reached, or gives no valid answer.
            NotPossible: the settings do not allow the request, and there is no cached answer.
        """
        base = self._services.nominatim_url
        query = "&".join(f"{key}={value}" for key, value in sorted(parameters.items()))

        def ask(url: str) -> object:
            del url  # osmnx takes it from its settings
            from osmnx import _nominatim

            return _nominatim._nominatim_request(OrderedDict(sorted(parameters.items())))

        question = f"nominatim {base} {query}"
        return self._ask(_Question(question, "Nominatim", (base,), ask, read_findings, is_sufficient=bool))

    def query(self, text: str) -> Answered[MapData]:
        """Return the JSON answer of the first available Overpass service to a query in its language.

        An empty answer counts only if a second service confirms it: some services cover only a part of the earth.

        Raises:
            ServiceFailure: no service gives a valid answer.
            NotPossible: the settings do not allow the request, and there is no cached answer.
        """

        def ask(url: str) -> object:
            return self._overpass(url, text)

        urls = self._services.overpass_urls
        question = f"overpass {text}"
        return self._ask(_Question(question, "Overpass", urls, ask, read_map_data, lambda it: bool(it["elements"])))

    def _ask(self, question: "_Question[_Read]") -> "Answered[_Read]":
        asks_none = self._services.mode == "cache"
        kept = self._cached(question, however_old=asks_none)
        fresh = kept is not None and (asks_none or question.is_sufficient(kept.answer) or kept.age_s < EMPTY_KEPT_S)
        if kept is not None and fresh:
            return Answered(kept.answer, kept.service, kept=True)
        if self._services.mode != "online":
            raise NotPossible(
                f"{question.kind} has no cached answer, and maps_online is {self._services.mode}, so it is not asked",
                next_step="set maps_online to online, or import an .osm extract of the place with import_files",
                reason=NOT_ASKED,
            )
        answered, troubles = self._first_answer(question)
        if answered is None:
            old = self._cached(question, however_old=True)
            if old is None:
                raise ServiceFailure(f"{question.kind} cannot be used: {'; '.join(troubles)}", reason=UNREACHED)
            return Answered(old.answer, old.service, True, (*troubles, "an old cached answer is used"))
        if not answered.kept:
            self._cache.keep(KeptAnswer(question.text, answered.service, time.time(), answered.answer))
        return answered

    def _cached(self, question: "_Question[_Read]", *, however_old: bool) -> "KeptAnswer[_Read] | None":
        """Return the cached answer; remove it if it is unreadable, for example because an earlier version wrote it."""
        kept = self._cache.find(question.text, however_old=however_old)
        if kept is None:
            return None
        try:
            return KeptAnswer(kept.question, kept.service, kept.asked_at, question.read(kept.answer))
        except NotReadable:
            self._cache.remove(question.text)
            return None

    def _first_answer(self, question: "_Question[_Read]") -> "tuple[Answered[_Read] | None, list[str]]":
        """Return the first answer with content, otherwise the first empty answer, and the failures before it."""
        empty: Answered[_Read] | None = None
        troubles: list[str] = []
        urls = question.urls
        for url in urls:
            host = _host_of(url)
            if time.monotonic() > self._give_up_at:
                troubles.append(f"{host} was not tried after the limit of {MOST_SECONDS:g} s")
                break
            self._report_step(f"asking {host}")
            try:
                found = Answered(self._patiently(url, question), host, kept=False)
            except Trouble as trouble:
                troubles.append(f"{host} {trouble}")
                continue
            if question.is_sufficient(found.answer):
                return _with(found, troubles), troubles
            if empty is not None:
                break
            empty = found
            troubles += [f"{host} has nothing there"] if len(urls) > 1 else []
        return (None if empty is None else _with(empty, troubles)), troubles

    def _patiently(self, url: str, question: "_Question[_Read]") -> _Read:
        """Return one service's answer; retry once if that may help."""

        def wait_s(state: RetryCallState) -> float:
            raised = state.outcome.exception() if state.outcome is not None else None
            named = raised.wait_s if isinstance(raised, Trouble) else None
            return FIRST_PAUSE_S * 2.0 ** (state.attempt_number - 1) if named is None else named

        def is_worth_it(raised: BaseException) -> bool:
            return isinstance(raised, Trouble) and raised.again and (raised.wait_s or 0.0) <= MOST_WAIT_S

        def report_retry(state: RetryCallState) -> None:
            self._report_step(f"{_host_of(url)}: asking again in {wait_s(state):.0f} s")

        again = Retrying(
            stop=stop_after_attempt(ATTEMPTS),
            retry=retry_if_exception(is_worth_it),
            wait=wait_s,
            before_sleep=report_retry,
            reraise=True,
        )
        answer: _Read = again(self._once, url, question)
        return answer

    def _once(self, url: str, question: "_Question[_Read]") -> _Read:
        _check_reachable(url)
        with _osmnx_set_up(self._services, url, self._report_size), self._turn(_host_of(url)):
            return _answer_of(question, url)

    def _report_size(self, size: int) -> None:
        if size >= self._reported_bytes + _MIB or size < self._reported_bytes:
            self._reported_bytes = size
            self._report_step(f"{size / _MIB:.1f} MB read")

    def _report_step(self, message: str) -> None:
        """Report the current step; the total is unknown, so the progress grows a little each time."""
        self._share += 0.05 * (_MOST_SHARE - self._share)
        self._report(self._share, message)

    def _overpass(self, url: str, text: str) -> object:
        """Send one request to one Overpass service, once it has a free slot, and return the answer."""
        from osmnx import _overpass, settings

        pause_s: float = _overpass._get_overpass_pause(url, default_pause=_UNKNOWN_PAUSE)
        if pause_s > MOST_WAIT_S:
            raise Trouble(f"has no slot free for {pause_s:.0f} s")
        if pause_s > 0:
            self._report_step(f"{_host_of(url)} has a slot in {pause_s:.0f} s")
            time.sleep(pause_s)
        settings.overpass_rate_limit = False  # its status was just checked; osmnx waits 60 s for an unknown one
        answer = _overpass._overpass_request(OrderedDict(data=text))
        remark = str(answer.get("remark", ""))
        if "error" in remark or "timed out" in remark:
            raise Trouble(f"gave up: {cited(remark, _LONGEST_REASON)}")
        return answer

    @contextmanager
    def _turn(self, host: str) -> Iterator[None]:
        """Wait for a turn at a host: all processes on the workspace send one request at a time, with pauses."""
        path = Path(self._services.cache) / f"{host.replace(':', '_')}.turn"
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a+b") as stream:
            fcntl.flock(stream, fcntl.LOCK_EX)
            stream.seek(0)
            last = stream.read().decode() or "0"
            time.sleep(min(max(float(last) + self._services.delay_s - time.time(), 0.0), self._services.delay_s))
            try:
                yield
            finally:
                stream.truncate(0)
                stream.write(str(time.time()).encode())
                stream.flush()


NOT_ASKED, UNREACHED, TOO_LARGE = "not_asked", "unreached", "too_large"
"""Reasons: the settings forbid requests; no service gave a valid answer; the answer exceeds the limit."""


def _with(found: Answered[_Read], troubles: Sequence[str]) -> Answered[_Read]:
    return Answered(found.answer, found.service, found.kept, tuple(troubles))


def _host_of(url: str) -> str:
    return urlsplit(url).netloc.rpartition("@")[2]


@contextmanager
def _osmnx_set_up(services: MapServices, url: str, report_size: Callable[[int], None]) -> Iterator[None]:
    """Apply the settings to osmnx for one service; restore osmnx's own settings afterwards."""
    from osmnx import settings

    deadline = time.monotonic() + services.timeout_s + CONNECT_S
    ours = {
        "nominatim_url": url,
        "overpass_url": url,
        "http_user_agent": services.user_agent,
        "http_referer": services.user_agent,
        "doh_url_template": None,  # no host other than the configured ones, not even to resolve a name
        "use_cache": False,
        "log_console": False,
        "log_file": False,
        "overpass_rate_limit": True,
        "requests_timeout": services.timeout_s,
        "requests_kwargs": {
            "allow_redirects": False,
            "stream": True,
            "hooks": {"response": _Guard((_host_of(url),), deadline, report_size)},
        },
    }
    before = {name: getattr(settings, name) for name in ours}
    lookup = socket.getaddrinfo
    try:
        for name, value in ours.items():
            setattr(settings, name, value)
        yield
    finally:
        for name, value in before.items():
            setattr(settings, name, value)
        socket.getaddrinfo = lookup  # osmnx replaces it with one that caches the address of a host


def _answer_of(question: _Question[_Read], url: str) -> _Read:
    """Return the service's validated answer; raise ``Trouble`` for any failure."""
    from requests.exceptions import RequestException, Timeout

    try:
        return question.read(question.ask(url))
    except NotReadable as error:
        raise Trouble(f"answered in another form than documented: {cited(error)}") from error
    except Timeout as error:
        raise Trouble("did not answer in time") from error
    except RequestException as error:
        raise Trouble("cannot be reached", again=True) from error
    except (ValueError, KeyError, AttributeError, TypeError, RecursionError) as error:  # osmnx's errors are ValueErrors
        raise Trouble("answered with something other than the requested JSON", again=True) from error


def _check_reachable(url: str) -> None:
    """Check within seconds that a host is reachable; behind a proxy, the proxy checks this.

    Raises:
        Trouble: the host is not reachable.
    """
    from requests.utils import get_environ_proxies

    if get_environ_proxies(url):
        return
    parts = urlsplit(url)
    address = (parts.hostname or "", parts.port or (443 if parts.scheme == "https" else 80))
    outcome: list[OSError | None] = []

    def try_it() -> None:  # in a thread: nothing else limits the time to resolve a name without a network
        try:
            socket.create_connection(address, timeout=CONNECT_S).close()
            outcome.append(None)
        except OSError as error:
            outcome.append(error)

    thread = threading.Thread(target=try_it, daemon=True)
    thread.start()
    thread.join(CONNECT_S)
    if not outcome:
        raise Trouble(f"cannot be reached: no answer within {CONNECT_S:g} s")
    if isinstance(outcome[0], socket.gaierror):
        raise Trouble("cannot be reached: its address cannot be looked up; there may be no network")
    if outcome[0] is not None:
        raise Trouble(f"cannot be reached: {outcome[0].strerror or outcome[0]}")


def settings_of_query(services: MapServices) -> str:
    """Return the start of an Overpass query: JSON, its own time limit and memory."""
    return f"[out:json][timeout:{max(int(services.timeout_s), 1)}][maxsize:{4 * MOST_BYTES}];"
