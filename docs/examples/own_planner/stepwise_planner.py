"""A stepwise planner in plain Python that follows its route, keeps its distance and stops at red lights."""

import json
import math
import sys


def nearest(path, x, y):
    """Return the index of the path's nearest point."""
    return min(range(len(path)), key=lambda i: math.hypot(path[i][0] - x, path[i][1] - y))


def gap(task, path, step):
    """Return the free metres to the first road user on the path within 1 s or red light, and its name."""
    here, length = nearest(path, step["ego"]["x_m"], step["ego"]["y_m"]), task["vehicle"]["length_m"]
    found = [(1000.0, "free")]
    for other in step["others"]:
        ahead = zip(other["predicted"]["x_m"], other["predicted"]["y_m"], strict=True)
        for x, y in list(ahead)[: round(1.0 / task["step_s"]) + 1]:
            at = nearest(path, x, y)
            if at > here and math.hypot(path[at][0] - x, path[at][1] - y) <= 2.0:
                found.append((at - here - (length + other["length_m"]) / 2, f"behind {other['id']}"))
    lights = [one for one in step["signals"] if one["state"].startswith("red") and one["ahead_m"] > length / 2]
    return min(found + [(one["ahead_m"] - length / 2, f"red light {one['id']}") for one in lights])


def plan(task, path, step):
    """Plan three seconds: steer to a point of the path ahead, at a speed that keeps the gap."""
    ego, vehicle, step_s = step["ego"], task["vehicle"], task["step_s"]
    behind, wheelbase = vehicle["rear_axle_behind_center_m"], vehicle["wheelbase_m"]
    turn = vehicle["maximum_steering_rate_radps"] * step_s
    heading, speed = ego["heading_rad"], ego["speed_mps"]
    x, y = ego["x_m"] - behind * math.cos(heading), ego["y_m"] - behind * math.sin(heading)  # the rear axle
    steering = math.atan(wheelbase * ego["yaw_rate_radps"] / max(speed, 1.0))
    free, why = gap(task, path, step)
    wanted = min(step["route"]["desired_speed_mps"], max(free - 2.0, 0.0) / task["weights"]["time_gap_s"])
    xs, ys, headings, speeds = [], [], [], []
    for _ in range(round(3.0 / step_s) + 1):
        xs.append(x + behind * math.cos(heading))
        ys.append(y + behind * math.sin(heading))
        headings.append(heading)
        speeds.append(speed)
        aim = path[min(nearest(path, x, y) + round(3 + 0.6 * speed), len(path) - 1)]
        distance, bearing = math.hypot(aim[0] - x, aim[1] - y), math.atan2(aim[1] - y, aim[0] - x)
        bend = math.atan(wheelbase * 2.0 * math.sin(bearing - heading) / max(distance, 1.0))
        steering = min(max(bend, steering - turn), steering + turn)
        allowed = math.sqrt(2.5 / max(abs(math.tan(steering)) / wheelbase, 1e-3))
        reached = max(speed + min(max(min(wanted, allowed) - speed, -5.0 * step_s), 1.5 * step_s), 0.0)
        way = (speed + reached) / 2 * step_s
        x, y = x + way * math.cos(heading), y + way * math.sin(heading)
        heading, speed = heading + way * math.tan(steering) / wheelbase, reached
    return {
        "type": "plan",
        "step": step["step"],
        "trajectory": {"x_m": xs, "y_m": ys, "heading_rad": headings, "speed_mps": speeds},
        "debug": {"numbers": {"gap_m": free, "wanted_mps": wanted}, "texts": {"why": why}},
    }


task, path = {}, []
for line in sys.stdin:
    message = json.loads(line)
    if message["type"] == "start":  # a run begins
        task, path = message, list(zip(*message["reference"].values(), strict=True))
        answer = {"type": "ready", "protocol": 1}
    else:
        answer = plan(task, path, message)
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()
