// An adapter for the AutoMCM conformance kit: it translates lines to calls of your station.
// It implements the whole adapter protocol, but the station is empty. Work through the TODOs.
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
    {"scenarios", json::array({"lane_change"})},              // TODO: scenarios that a request may name
    {"fixed", json::object()},    // TODO: parameters that cannot be changed, such as t_resend
};

// TODO: replace this with your station.
class Station {
public:
    Station(std::int64_t /*now*/, std::uint32_t /*station_id*/, std::uint64_t /*seed*/,
            const json& /*parameters*/) {}

    // TODO: fire each timer due at now or earlier, in the order of protocol.md section 3.
    void advance(std::int64_t /*now*/) {}

    // TODO: handle a message; planned is null unless an Advertisement concerns the station.
    void receive(const json& /*message*/, const json& /*planned*/) {}

    // TODO: handle request, close, prescribe, proceed, complete, abort, accept and refuse.
    void command(const std::string& /*name*/, const json& /*command*/) {}

    // TODO: the time (not the duration) of the earliest armed timer, if any.
    std::optional<std::int64_t> deadline() const { return std::nullopt; }

    // Everything since the last answer. TODO: add "phase" if the station can report it.
    json answer() {
        const auto next = deadline();
        return {{"messages", std::exchange(messages_, json::array())},
                {"indications", std::exchange(indications_, json::array())},
                {"deadline", next ? json(*next) : json(nullptr)}};
    }

private:
    json messages_ = json::array();       // TODO: add each message that is sent
    json indications_ = json::array();    // TODO: add each indication to the application
};

// Translates a command to calls of the station.
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
    station->advance(line.at("now"));    // timers come before any other input of the same instant
    if (cmd == "receive") station->receive(line.at("message"), line.value("planned", json()));
    if (cmd == "command") station->command(line.at("command").at("name"), line.at("command"));
    return station->answer();
}

int main() {
    std::ios::sync_with_stdio(false);
    std::optional<Station> station;
    for (std::string line; std::getline(std::cin, line);) {
        json reply;
        try {
            const json command = json::parse(line);
            if (command.at("cmd") == "stop") break;
            reply = answer(command, station);
        } catch (const std::exception& error) {
            reply = {{"error", error.what()}};
        }
        // Print anything else to std::cerr.
        std::cout << reply.dump(-1, ' ', true, json::error_handler_t::replace) << std::endl;
    }
}
