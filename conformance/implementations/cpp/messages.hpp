// The form of a message and of a command: which fields, with which values. Written from
// docs/messages.md alone: it is independent of automcm_spec.vocabulary.messages.
//
// What is malformed is so whoever sends it and whatever the station does; all of that is here.
// What depends on the station is in station.hpp.
#pragma once

#include <algorithm>
#include <cstdint>
#include <initializer_list>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include <nlohmann/json.hpp>

namespace automcm {

using json = nlohmann::json;
using Int = std::int64_t;
using Id = std::int64_t;                  // of a station

constexpr Int max_integer = (Int{1} << 53) - 1;
constexpr Id max_station = (Id{1} << 32) - 1;
constexpr std::size_t max_text = 65507, max_marks = 255;
constexpr int max_depth = 32;

// 1.0, true and what is beyond 53 bits are no integers.
inline bool is_integer(const json& value, Int low = -max_integer, Int high = max_integer) {
    if (!value.is_number_integer()) return false;
    if (value.is_number_unsigned() && value.get<std::uint64_t>() > std::uint64_t{max_integer}) return false;
    const Int number = value.get<Int>();
    return low <= number && number <= high;
}

inline bool any_integer(const json& value) { return is_integer(value); }
inline bool from_zero(const json& value) { return is_integer(value, 0); }
inline bool from_one(const json& value) { return is_integer(value, 1); }
inline bool is_station(const json& value) { return is_integer(value, 1, max_station); }
inline bool is_extent(const json& value) { return is_integer(value, 100, 102'100); }
inline bool is_station_type(const json& value) { return is_integer(value, 0, 255); }
inline bool is_bool(const json& value) { return value.is_boolean(); }

// The bound of a text counts characters, not the bytes of their UTF-8.
inline bool short_enough(const std::string& text) {
    const auto starts = [](char byte) { return (byte & 0xC0) != 0x80; };
    return text.size() <= max_text
           || static_cast<std::size_t>(std::count_if(text.begin(), text.end(), starts)) <= max_text;
}

inline bool is_text(const json& value) {
    return value.is_string() && short_enough(value.get_ref<const std::string&>());
}

inline bool is_detail(const json& value, int depth) {
    if (value.is_string()) return is_text(value);
    if (!value.is_structured()) return value.is_boolean() || is_integer(value);
    if (depth > max_depth) return false;
    for (const auto& item : value.items()) {
        if (value.is_object() && !short_enough(item.key())) return false;
        if (!is_detail(item.value(), depth + 1)) return false;
    }
    return true;
}

inline bool is_details(const json& value) { return value.is_object() && is_detail(value, 1); }

inline bool is_session(const json& value) {
    return value.is_array() && value.size() == 2 && is_station(value[0]) && from_one(value[1]);
}

inline bool is_marks(const json& value) {
    return value.is_array() && value.size() <= max_marks
           && std::all_of(value.begin(), value.end(), is_session);
}

inline bool is_point(const json& value) {
    return value.is_array() && value.size() == 3
           && std::all_of(value.begin(), value.end(), any_integer);
}

// The fields of an object: all that are required, with values that pass, and no others.
struct Field {
    const char* name;
    bool (*allowed)(const json&);
    bool required = true;
};
using Fields = std::vector<Field>;

inline bool has_fields(const json& object, const Fields& fields, bool others_too = false) {
    if (!object.is_object()) return false;
    std::size_t seen = 0;
    for (const Field& field : fields) {
        const auto found = object.find(field.name);
        if (found == object.end()) {
            if (field.required) return false;
        } else {
            if (!field.allowed(*found)) return false;
            ++seen;
        }
    }
    return others_too || seen == object.size();
}

inline bool is_trajectory(const json& value) {
    static const Fields fields{
        {"t0", any_integer},
        {"points", [](const json& points) {
             return points.is_array() && !points.empty()
                    && std::all_of(points.begin(), points.end(), is_point);
         }}};
    return has_fields(value, fields);
}

using Texts = std::initializer_list<std::string_view>;

inline bool is_one_of(const json& value, Texts texts) {
    return value.is_string()
           && std::find(texts.begin(), texts.end(), value.get_ref<const std::string&>()) != texts.end();
}

inline bool is_type(const json& value) {
    return is_one_of(value, {"Advertisement", "Intention", "Prescription", "Acceptance", "Fin",
                             "Cancel", "Ack"});
}

inline bool is_refusal(const json& value) {
    return is_one_of(value, {"unsafe", "undecided", "busy", "unknown_session"});
}

inline bool is_reason(const json& value) {
    return is_one_of(value, {"not_selected", "not_needed", "no_agreement", "timeout", "cam_loss",
                             "lease_expired", "abort", "closed"});
}

inline bool is_acknowledged(const json& value) {
    return has_fields(value, {{"type", is_type}, {"seq", from_zero}});
}

// An addressed message has a dst; an Advertisement and a CAM have none (END-5).
inline const std::map<std::string, Fields>& message_fields() {
    static const auto with = [](Fields common, const Fields& own) {
        common.insert(common.end(), own.begin(), own.end());
        return common;
    };
    static const Fields every{{"v", [](const json& v) { return is_integer(v, 1, 1); }},
                              {"type", [](const json&) { return true; }},
                              {"src", is_station}};
    static const Fields broadcast = with(every, {{"session", is_session}, {"seq", from_zero}});
    static const Fields addressed = with(broadcast, {{"dst", is_station}});
    static const std::map<std::string, Fields> fields{
        {"Advertisement", with(broadcast, {{"scenario", is_text}, {"details", is_details},
                                           {"planned", is_trajectory, false}})},
        {"Intention", with(addressed, {{"planned", is_trajectory}, {"length_mm", is_extent, false},
                                       {"width_mm", is_extent, false}})},
        {"Prescription", with(addressed, {{"proposal", from_one}, {"prescribed", is_trajectory},
                                          {"hold_ms", from_zero}, {"lease_ms", from_one}})},
        {"Acceptance", with(addressed, {{"proposal", from_one}, {"accepted", is_bool},
                                        {"selected", is_trajectory, false},
                                        {"reason", is_refusal, false}})},
        {"Fin", addressed},
        {"Cancel", with(addressed, {{"reason", is_reason}})},
        {"Ack", with(addressed, {{"of", is_acknowledged}})},
        {"CAM", with(every, {{"generation_ms", from_zero}, {"x_mm", any_integer},
                             {"y_mm", any_integer}, {"heading_mrad", any_integer},
                             {"speed_mm_s", any_integer}, {"marks", is_marks},
                             {"length_mm", is_extent, false}, {"width_mm", is_extent, false},
                             {"station_type", is_station_type, false},
                             {"sigma_mm", from_zero, false}})}};
    return fields;
}

// Answers, and they alone, have seq 0 (section 2).
inline bool is_answer(const json& message) {
    const auto reason = message.find("reason");
    return message["type"] == "Ack"
           || (reason != message.end() && is_one_of(*reason, {"busy", "unknown_session", "closed"}));
}

inline bool is_well_formed(const json& message) {
    if (!message.is_object()) return false;
    const auto type = message.find("type");
    if (type == message.end() || !type->is_string()) return false;
    const auto fields = message_fields().find(type->get_ref<const std::string&>());
    if (fields == message_fields().end() || !has_fields(message, fields->second)) return false;
    if (fields->first == "CAM") return true;
    if (fields->first == "Acceptance") {
        const bool accepted = message["accepted"];
        if (message.contains("selected") != accepted || message.contains("reason") == accepted) {
            return false;
        }
    }
    return is_answer(message) == (message["seq"] == 0);
}

// What the application may say; a field that is not named here is not looked at.
inline const std::map<std::string, Fields>& command_fields() {
    static const Fields plain{{"session", is_session}};
    static const std::map<std::string, Fields> fields{
        {"request", {{"scenario", is_text}, {"details", is_details},
                     {"planned", is_trajectory, false}}},
        {"prescribe", {{"session", is_session}, {"proposal", from_one}, {"target", is_station},
                       {"prescribed", is_trajectory}, {"hold_ms", from_zero},
                       {"lease_ms", from_one}}},
        {"close", plain}, {"proceed", plain}, {"complete", plain}, {"abort", plain},
        {"accept", {{"session", is_session}, {"proposal", from_one}, {"selected", is_trajectory}}},
        {"refuse", {{"session", is_session}, {"proposal", from_one}}}};
    return fields;
}

}  // namespace automcm
