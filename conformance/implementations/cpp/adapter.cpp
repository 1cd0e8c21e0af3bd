// The adapter of docs/adapter.md: a line becomes a call of the station, its result a line.

#include <cstdio>
#include <optional>
#include <stdexcept>
#include <string>

#include "lines.hpp"
#include "station.hpp"
#include "trace_log.hpp"

using namespace automcm;

static const char* const name = "automcm-cpp";
static const char* const version = "0.1.0";

static Int integer(const json& object, const char* name, Int low = -max_integer, Int high = max_integer) {
    const json& value = object.at(name);
    if (!is_integer(value, low, high)) throw std::invalid_argument(std::string(name) + " is not allowed");
    return value.get<Int>();
}

static json hello(const json& line) {
    integer(line, "protocol", 1, 1);
    return {{"protocol", 1},
            {"name", name},
            {"version", version},
            {"issues", "the issues of the AutoMCM project"},
            {"features", {"prescriber", "receiver", "restart", "durations", "cam", "clock_drift"}},
            {"scenarios", {"lane_change", "merge"}},
            {"fixed", json::object()}};
}

static Parameters parameters_of(const json& given) {
    Parameters p;
    p.t_timeout = integer(given, "t_timeout", 0);
    p.t_resend = integer(given, "t_resend", 1);
    p.t_decide = integer(given, "t_decide", 0);
    p.t_cam_loss = integer(given, "t_cam_loss", 0);
    p.t_cam = integer(given, "t_cam", 1);
    p.backoff_min = integer(given, "backoff_min", 0);
    p.backoff_max = integer(given, "backoff_max", 0);
    p.max_rounds = integer(given, "max_rounds", 1);
    p.max_participants = integer(given, "max_participants", 1);
    p.outbox_limit = integer(given, "outbox_limit", 0);
    p.memory_limit = integer(given, "memory_limit", 0);
    p.clock_drift = given.contains("clock_drift") ? integer(given, "clock_drift", 1, 99) : 0;
    return p;
}

static Station new_station(const json& line) {
    return Station(integer(line, "station", 1, max_station), parameters_of(line.at("parameters")),
                   static_cast<std::uint64_t>(integer(line, "seed")), integer(line, "now"));
}

static Output receive(Station& station, const json& line) {
    const json& message = line.at("message");
    const auto planned = line.find("planned");
    if (planned != line.end() && !is_trajectory(*planned)) {
        throw std::invalid_argument("planned is no trajectory");
    }
    return station.receive(message, planned == line.end() ? nullptr : &*planned, integer(line, "now"));
}

static Output command(Station& station, const json& line) {
    const json& command = line.at("command");
    const std::string name = command.at("name");
    if (command_fields().count(name) == 0) throw std::invalid_argument("unknown command " + name);
    return station.command(command, integer(line, "now"));
}

static Output set_durations(Station& station, const json& line) {
    const json& durations = line.at("durations");
    for (const auto& item : durations.items()) {
        integer(durations, item.key().c_str(), 1);
        if (!Station::is_timer(item.key())) throw std::invalid_argument("no timer " + item.key());
    }
    for (const auto& item : durations.items()) station.set_duration(item.key(), item.value());
    return {};
}

// All that can be wrong with a line is looked at before the station is touched.
static Output carry_out(std::optional<Station>& station, const std::string& cmd, const json& line) {
    if (cmd == "reset") {
        station = new_station(line);
        return {};
    }
    if (!station) throw std::invalid_argument("there is no station before the first reset");
    if (cmd == "receive") return receive(*station, line);
    if (cmd == "command") return command(*station, line);
    if (cmd == "advance") return station->advance(integer(line, "now"));
    if (cmd == "restart") return station->restart(integer(line, "now"));
    if (cmd == "durations") return set_durations(*station, line);
    throw std::invalid_argument("unknown cmd " + cmd);
}

static void record(TraceLog& log, Station& station, const std::string& cmd, const json& line,
                   const Output& output) {
    if (cmd == "reset") {
        station.keep_steps();
        log.begin(station.id(), station.parameters());
    } else if (cmd == "durations") {
        log.set_durations(line.at("durations"));
    } else {
        log.write(output.steps);
    }
}

static json answer_to(std::optional<Station>& station, std::optional<TraceLog>& log,
                      const std::string& cmd, const json& line) {
    if (cmd == "hello") return hello(line);
    Output output = carry_out(station, cmd, line);
    if (log) record(*log, *station, cmd, line, output);
    json answer{{"phase", station->phase()}, {"deadline", nullptr}};
    if (const auto deadline = station->deadline()) answer["deadline"] = *deadline;
    answer["messages"] = std::move(output.messages);
    answer["indications"] = std::move(output.indications);
    if (!output.cams.empty()) answer["cams"] = std::move(output.cams);
    return answer;
}

int main(int count, char** words) {
    std::optional<TraceLog> log;
    if (count == 3 && words[1] == std::string("--log")) {
        log.emplace(words[2], name, version);
    } else if (count != 1) {
        std::fprintf(stderr, "usage: %s [--log FILE]\n", words[0]);
        return 2;
    }
    Lines lines;
    std::optional<Station> station;
    for (std::string text; lines.next(text);) {
        json answer;
        try {
            const json line = json::parse(text);
            const std::string cmd = line.at("cmd");
            if (cmd == "stop") break;
            answer = answer_to(station, log, cmd, line);
        } catch (const std::exception& error) {
            answer = {{"error", error.what()}};
        }
        lines.write(answer.dump(-1, ' ', false, json::error_handler_t::replace));
    }
    lines.flush();
    return 0;
}
