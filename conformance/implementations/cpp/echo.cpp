// The floor for a benchmark: what reading, parsing and writing lines cost without any station. It
// names the features of the station beside it, so that a kit sends it the same lines.

#include <exception>
#include <string>

#include <nlohmann/json.hpp>

#include "lines.hpp"

using nlohmann::json;

int main() {
    const std::string hello = json{{"protocol", 1},
                                   {"name", "echo"},
                                   {"version", "0.1.0"},
                                   {"issues", "the issues of the AutoMCM project"},
                                   {"features", {"prescriber", "receiver", "restart", "durations", "cam",
                                                 "clock_drift"}},
                                   {"scenarios", {"lane_change", "merge"}},
                                   {"fixed", json::object()}}.dump();
    const json nothing{{"messages", json::array()}, {"indications", json::array()}, {"deadline", nullptr}};
    Lines lines;
    for (std::string text; lines.next(text);) {
        try {
            const json line = json::parse(text);
            const std::string cmd = line.at("cmd");
            if (cmd == "stop") break;
            lines.write(cmd == "hello" ? hello : nothing.dump());
        } catch (const std::exception& error) {
            lines.write(json{{"error", error.what()}}.dump(-1, ' ', false, json::error_handler_t::replace));
        }
    }
    lines.flush();
    return 0;
}
