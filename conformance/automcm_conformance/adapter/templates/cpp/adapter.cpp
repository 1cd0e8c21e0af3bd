// An adapter for the AutoMCM conformance kit: from lines to your station and back.
// It speaks the whole protocol; the station in it does nothing yet. Go through the TODOs.
#include <cstdint>
#include <exception>
#include <iostream>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include <nlohmann/json.hpp>

using nlohmann::json;

const json about = {
    {"protocol", 1},
    {"name", "my station"},                                   // TODO
    {"version", "0.1"},                                       // TODO
    {"issues", "where to report a bug in it"},                // TODO
    {"features", json::array({"prescriber", "receiver"})},    // TODO: restart, durations, cam
    {"scenarios", json::array({"lane_change"})},              // TODO: what it takes in a request
    {"fixed", json::object()},    // TODO: parameters that it cannot change, such as t_resend
};

// TODO: your station in the place of this one, which hears nothing and says nothing.
class Station {
public:
    Station(std::int64_t /*now*/, std::uint32_t /*station_id*/, std::uint64_t /*seed*/,
            const json& /*parameters*/) {}

    // TODO: fire each timer that is due at now or was before, in the order of time.
    void advance(std::int64_t /*now*/) {}

    // TODO: a message; planned is null if an Advertisement does not concern the station.
    void receive(const json& /*message*/, const json& /*planned*/) {}

    // TODO: request, prescribe, proceed, complete, abort, accept or refuse.
    void command(const std::string& /*name*/, const json& /*command*/) {}

    // TODO: the time (not the duration) at which the next timer is due; nothing if none is.
    std::optional<std::int64_t> deadline() const { return std::nullopt; }

    // All that happened since the last answer. TODO: add "phase" if the station can tell it.
    json answer() {
        const auto next = deadline();
        return {{"messages", std::exchange(messages_, json::array())},
                {"indications", std::exchange(indications_, json::array())},
                {"deadline", next ? json(*next) : json(nullptr)}};
    }

private:
    json messages_ = json::array();       // TODO: put here what is sent, as JSON objects
    json indications_ = json::array();    // TODO: and here what the application is told
};

// Turns a command into calls of the station.
json answer(const json& line, std::optional<Station>& station) {
    const std::string cmd = line.at("cmd");
    if (cmd == "hello") return about;
    if (cmd == "reset") {
        station.emplace(line.at("now"), line.at("station"), line.at("seed"), line.at("parameters"));
        return station->answer();
    }
    if (!station) throw std::runtime_error("reset comes first");
    if (cmd != "receive" && cmd != "command" && cmd != "advance")
        throw std::runtime_error("unknown command " + cmd);
    station->advance(line.at("now"));    // timers before anything else of the same instant
    if (cmd == "receive") station->receive(line.at("message"), line.value("planned", json()));
    if (cmd == "command") station->command(line.at("command").at("name"), line.at("command"));
    return station->answer();
}

int main() {
    std::ios::sync_with_stdio(false);
    std::optional<Station> station;
    for (std::string line; std::getline(std::cin, line);) {
        json told;
        try {
            const json command = json::parse(line);
            if (command.at("cmd") == "stop") break;
            told = answer(command, station);
        } catch (const std::exception& error) {
            told = {{"error", error.what()}};
        }
        // Print anything else to std::cerr.
        std::cout << told.dump(-1, ' ', true, json::error_handler_t::replace) << std::endl;
    }
}
