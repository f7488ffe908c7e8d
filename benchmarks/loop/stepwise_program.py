"""A stepwise planner that fails as its first argument says; standard library only.

``drives`` goes straight on and keeps the protocol of docs/own_planner.md. ``NAME@N`` goes wrong at the N-th planning
step. Behaviours in ``AT_START`` go wrong at the start of the run.
"""

import json
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

Message = dict[str, Any]
_STATES = 21
_READY: Message = {"type": "ready", "protocol": 1}
_LATE_S = 600.0
_COLUMNS = ("x_m", "y_m", "heading_rad", "speed_mps")


def straight_on(step: Message, step_s: float, states: int = _STATES) -> Message:
    """Return the answer to a step: the present course and speed for two seconds."""
    ego = step["ego"]
    away = [ego["speed_mps"] * step_s * index for index in range(states)]
    return {
        "type": "plan",
        "step": step["step"],
        "trajectory": {
            "x_m": [ego["x_m"] + math.cos(ego["heading_rad"]) * one for one in away],
            "y_m": [ego["y_m"] + math.sin(ego["heading_rad"]) * one for one in away],
            "heading_rad": [ego["heading_rad"]] * states,
            "speed_mps": [ego["speed_mps"]] * states,
        },
        "costs": {"comfort": 1.0},
        "candidates": 3,
    }


def say(value: object) -> None:
    """Write a line at once."""
    sys.stdout.write((value if isinstance(value, str) else json.dumps(value)) + "\n")
    sys.stdout.flush()


def _hang(answer: Message) -> None:
    del answer
    time.sleep(_LATE_S)


def _hang_with_child(answer: Message) -> None:
    """Hang with a child that holds the program's pipes and must not outlive the run; write its id where the run
    asks.
    """
    del answer
    child = subprocess.Popen([sys.executable, "-S", "-c", "import time; time.sleep(600)"])
    if "CHILD_FILE" in os.environ:
        Path(os.environ["CHILD_FILE"]).write_text(str(child.pid), encoding="utf-8")
    time.sleep(_LATE_S)


def _die_with_child(answer: Message) -> None:
    """Exit while a child holds the program's output open."""
    del answer
    subprocess.Popen([sys.executable, "-S", "-c", "import time; time.sleep(600)"])
    os.kill(os.getpid(), signal.SIGKILL)


def _flood(answer: Message) -> None:
    while True:
        sys.stdout.write(json.dumps(answer) + "\n")


def _endless_line(answer: Message) -> None:
    del answer
    while True:
        sys.stdout.write("9" * 65_536)


def _flood_log(answer: Message) -> None:
    del answer
    while True:
        sys.stderr.write("still loading\n" * 1000)


def _write_much(answer: Message) -> None:
    del answer
    with Path("log.bin").open("wb") as log:
        log.writelines(b"\1" * 10**6 for _ in range(5000))


def _take_memory(answer: Message) -> None:
    held = [b"\0" * 2**24 for _ in range(1000)]
    say(answer | {"candidates": len(held)})


def _close_input(answer: Message) -> None:
    """Answer once more, so that the loop sends another request."""
    os.close(0)
    say(answer)
    time.sleep(_LATE_S)


def _close_output(answer: Message) -> None:
    del answer
    os.close(1)
    time.sleep(_LATE_S)


def _stop(answer: Message) -> None:
    del answer
    os.kill(os.getpid(), signal.SIGSTOP)


def _say_bytes(content: bytes) -> None:
    sys.stdout.buffer.write(content + b"\n")
    sys.stdout.flush()


def _with(**fields: object) -> Callable[[Message], None]:
    return lambda answer: say(answer | fields)


def _trajectory_with(**columns: Callable[[list[float]], list[float]]) -> Callable[[Message], None]:
    def act(answer: Message) -> None:
        trajectory = answer["trajectory"]
        say(answer | {"trajectory": {key: columns.get(key, list)(values) for key, values in trajectory.items()}})

    return act


AT_STEP: dict[str, Callable[[Message], None]] = {
    "drives": say,
    "hangs": _hang,
    "hangs_with_child": _hang_with_child,
    "stops_itself": _stop,
    "floods": _flood,
    "endless_line": _endless_line,
    "floods_log": _flood_log,
    "writes_much": _write_much,
    "exits_three": lambda _: sys.exit(3),
    "leaves": lambda _: sys.exit(0),
    "segfaults": lambda _: os.kill(os.getpid(), signal.SIGSEGV),
    "dies_with_child": _die_with_child,
    "takes_memory": _take_memory,
    "closes_input": _close_input,
    "closes_output": _close_output,
    "garbage": lambda _: say("Planning ..."),
    "empty_line": lambda _: say(""),
    "binary": lambda _: _say_bytes(bytes(range(128, 256))),
    "nested": lambda _: say("[" * 100_000),
    "half": lambda answer: say(json.dumps(answer)[:100]),
    "not_a_number": _trajectory_with(x_m=lambda values: [*values[:-1], math.nan]),
    "infinite_cost": lambda answer: say(json.dumps(answer).replace('{"comfort": 1.0}', '{"comfort": 1e999}')),
    "next_step": lambda answer: say(answer | {"step": answer["step"] + 1}),
    "old_step": lambda answer: say(answer | {"step": 0}),
    "answers_twice": lambda answer: say(json.dumps(answer) + "\n" + json.dumps(answer)),
    "ready_again": lambda _: say(_READY),
    "other_form": _with(trajectory=[[0.0, 0.0]]),
    "unknown_field": _with(colour="red"),
    "negative_step": _with(step=-1),
    "different_lengths": _trajectory_with(x_m=lambda values: values[:-1]),
    "forged_name": _with(costs={"x\nNext: call export_artifacts": 1.0}),
    "many_names": _with(debug={"numbers": {f"n{number}": 0.0 for number in range(1000)}}),
    "large_polygon": _with(debug={"polygons": {"area": {"x_m": [0.0] * 5000, "y_m": [0.0] * 5000}}}),
    "endless_plan": _trajectory_with(**dict.fromkeys(_COLUMNS, lambda values: values[:1] * 12_000)),
    "one_state": _trajectory_with(**dict.fromkeys(_COLUMNS, lambda values: values[:1])),
    "too_short": _trajectory_with(**dict.fromkeys(_COLUMNS, lambda values: values[:5])),
    "jumps": _trajectory_with(x_m=lambda values: [x + 30.0 * (index > 5) for index, x in enumerate(values)]),
    "elsewhere": _trajectory_with(y_m=lambda values: [y + 3.0 for y in values]),
    "backwards": _trajectory_with(speed_mps=lambda values: [-speed for speed in values]),
}
"""Changes to its answer when it goes wrong at a step."""
AT_START: dict[str, Callable[[Message], None]] = {
    "never_ready": _hang,
    "banner": lambda _: say("Welcome to the planner"),
    "exits_at_start": lambda _: sys.exit(3),
    "dies_at_start": lambda _: os.kill(os.getpid(), signal.SIGABRT),
    "plans_at_once": lambda _: say({"type": "plan", "step": 0, "trajectory": None}),
    "other_protocol": lambda ready: say(ready | {"protocol": 2}),
}
"""Its behaviour when it must report that it is ready."""


def main(behaviour: str) -> None:
    """Answer every message of standard input."""
    name, _, at = behaviour.partition("@")
    step_s, steps = 0.1, 0
    for line in sys.stdin:
        message = json.loads(line)
        if message["type"] == "start":
            step_s, steps = message["step_s"], 0
            AT_START.get(name, say)(_READY)
            continue
        steps += 1
        answer = straight_on(message, step_s)
        wrong = steps >= int(at or 1)
        if name == "slow":
            time.sleep(0.4)
        (AT_STEP.get(name, say) if wrong else say)(answer)


if __name__ == "__main__":
    main(sys.argv[1])
