// A stepwise planner that follows its route, keeps its distance and stops at red lights. C++17, standard library only.
// Build it with: g++ -O2 -std=c++17 -o stepwise_planner stepwise_planner.cpp
#include <algorithm>
#include <cmath>
#include <cstring>
#include <iostream>
#include <stdexcept>
#include <string>
#include <vector>
using Numbers = std::vector<double>;

struct Json {  // a value; true is the number 1, false and null are 0; an object is a list of names and values in turn
    double number = 0;
    std::string text;
    std::vector<Json> items;
    const Json& operator[](const char* name) const {
        for (size_t i = 0; i + 1 < items.size(); i += 2) if (items[i].text == name) return items[i + 1];
        throw std::runtime_error(std::string("there is no ") + name);
    }
    operator double() const { return number; }
    operator Numbers() const { return Numbers(items.begin(), items.end()); }
};

const char* next(const char* at) { return at + std::strspn(at, " ,:"); }  // the brackets say as much
Json read(const char*& at) {  // one value of valid JSON; \n and \u in strings stay escaped
    Json made;
    const char* begin = at;
    if (*at == '{' || *at == '[') {
        for (at = next(at + 1); *at != '}' && *at != ']'; at = next(at)) made.items.push_back(read(at));
        ++at;
    } else if (*at == '"') {
        while (*++at && *at != '"') made.text += *at == '\\' && at[1] ? *++at : *at;
        if (!*at++) throw std::runtime_error("a text does not end");
    } else if (std::isalpha(*at)) {
        for (made.number = *at == 't'; std::isalpha(*at);) ++at;
    } else {
        made.number = std::strtod(begin, const_cast<char**>(&at));
        if (at == begin) throw std::runtime_error("a value is missing");
    }
    return made;
}

std::string list(const Numbers& values) {
    std::string out = "[";
    for (double value : values) out += (out.size() > 1 ? "," : "") + std::to_string(value);
    return out + "]";
}

struct Planner {
    Json task;
    Numbers path_x, path_y;  // the reference path, about one point per metre
    int nearest(double x, double y) const {
        int best = 0;
        for (int i = 0; i < (int)path_x.size(); ++i)
            if (std::hypot(path_x[i] - x, path_y[i] - y) < std::hypot(path_x[best] - x, path_y[best] - y)) best = i;
        return best;
    }
    // The free metres to the first road user on the path within 1 s or red light, and its name.
    std::pair<double, std::string> gap(const Json& step) const {
        double length = task["vehicle"]["length_m"], least = 1000;
        std::string why = "free";
        int here = nearest(step["ego"]["x_m"], step["ego"]["y_m"]);
        for (const Json& other : step["others"].items) {
            Numbers x = other["predicted"]["x_m"], y = other["predicted"]["y_m"];
            for (size_t i = 0; i < x.size() && i * task["step_s"] <= 1.0; ++i) {
                int at = nearest(x[i], y[i]);
                double free = at - here - (length + other["length_m"]) / 2;
                if (at <= here || std::hypot(path_x[at] - x[i], path_y[at] - y[i]) > 2 || free >= least) continue;
                least = free, why = "behind " + std::to_string((long)other["id"].number);
            }
        }
        for (const Json& signal : step["signals"].items) {
            double free = signal["ahead_m"] - length / 2;
            if (signal["state"].text.substr(0, 3) != "red" || free < 0 || free >= least) continue;
            least = free, why = "red light " + std::to_string((long)signal["id"].number);
        }
        return {least, why};
    }
    std::string plan(const Json& step) const {
        const Json &ego = step["ego"], &car = task["vehicle"];
        double dt = task["step_s"], behind = car["rear_axle_behind_center_m"], wheelbase = car["wheelbase_m"];
        double heading = ego["heading_rad"], speed = ego["speed_mps"], turn = car["maximum_steering_rate_radps"] * dt;
        double x = ego["x_m"] - behind * std::cos(heading), y = ego["y_m"] - behind * std::sin(heading);  // rear axle
        double steering = std::atan(wheelbase * ego["yaw_rate_radps"] / std::max(speed, 1.0));
        auto [free, why] = gap(step);
        double allowed = std::max(free - 2, 0.0) / task["weights"]["time_gap_s"];
        double wanted = std::min<double>(step["route"]["desired_speed_mps"], allowed);
        Numbers xs, ys, headings, speeds;
        for (int i = 0; i <= std::lround(3.0 / dt); ++i) {
            xs.push_back(x + behind * std::cos(heading)), ys.push_back(y + behind * std::sin(heading));
            headings.push_back(heading), speeds.push_back(speed);
            int aim = std::min<int>(nearest(x, y) + std::lround(3 + 0.6 * speed), path_x.size() - 1);
            double dx = path_x[aim] - x, dy = path_y[aim] - y;  // the rear axle steers to a point of the path ahead
            double curvature = 2 * std::sin(std::atan2(dy, dx) - heading) / std::max(std::hypot(dx, dy), 1.0);
            steering = std::clamp(std::atan(wheelbase * curvature), steering - turn, steering + turn);
            double in_bend = std::sqrt(2.5 / std::max(std::abs(std::tan(steering)) / wheelbase, 1e-3));
            double reached = std::max(speed + std::clamp(std::min(wanted, in_bend) - speed, -5 * dt, 1.5 * dt), 0.0);
            double way = (speed + reached) / 2 * dt;
            x += way * std::cos(heading), y += way * std::sin(heading);
            heading += way * std::tan(steering) / wheelbase, speed = reached;
        }
        return R"({"type":"plan","step":)" + std::to_string((long)step["step"].number) + R"(,"trajectory":{"x_m":)"
            + list(xs) + R"(,"y_m":)" + list(ys) + R"(,"heading_rad":)" + list(headings) + R"(,"speed_mps":)"
            + list(speeds) + R"(},"debug":{"numbers":{"gap_m":)" + std::to_string(free) + R"(,"wanted_mps":)"
            + std::to_string(wanted) + R"(},"texts":{"why":")" + why + R"("}}})";
    }
};

int main() {
    Planner planner;
    for (std::string line; std::getline(std::cin, line);) {
        const char* at = line.c_str();
        Json message = read(at);
        if (message["type"].text == "step") std::cout << planner.plan(message) << std::endl;
        else {  // a run begins
            planner = {message, message["reference"]["x_m"], message["reference"]["y_m"]};
            std::cout << R"({"type":"ready","protocol":1})" << std::endl;
        }
    }
}
