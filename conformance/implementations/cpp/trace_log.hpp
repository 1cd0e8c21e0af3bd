// What a station did, as logs in the format automcm.trace/1 (docs/trace-format.md).
//
// The station says what it did, step by step; all that knows the format and the files is here.
#pragma once

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "station.hpp"

namespace automcm {

// A log for each station that is made: FILE, then FILE-2 and so on; what is there already stays.
class TraceLog {
public:
    TraceLog(std::filesystem::path path, std::string name, std::string version)
        : path_(std::move(path)), name_(std::move(name)), version_(std::move(version)) {}
    TraceLog(const TraceLog&) = delete;
    TraceLog& operator=(const TraceLog&) = delete;
    ~TraceLog() { end("clean"); }

    // A new station. Its file is made with its first event.
    void begin(Id station, const Parameters& parameters) {
        end("clean");
        station_ = station;
        parameters_ = parameters;
        seq_ = transmissions_ = lost_ = 0;
        last_at_ = 0;
        constant_ = wanted_ = true;
    }

    // Timers no longer last as long as the parameters say. The header then leaves them out; if it
    // has been written, the log ends, for the rest would not fit it. No header tells of these two:
    void set_durations(const json& durations) {
        const auto told = [](const auto& item) { return item.key() != "backoff" && item.key() != "forget"; };
        const auto& items = durations.items();
        if (!std::any_of(items.begin(), items.end(), told)) return;
        if (file_ != nullptr && constant_) {
            end("durations");
            wanted_ = false;
        }
        constant_ = false;
    }

    void write(const std::vector<Step>& steps) {
        if (!wanted_) return;
        for (const Step& step : steps) write(step);
        if (file_ != nullptr && std::fflush(file_) != 0) fail("cannot be written");
    }

    // Nothing is left out of it, unless lost_records says so.
    void end(const char* reason) {
        if (file_ == nullptr) return;
        put({{"rec", "end"}, {"seq", seq_}, {"reason", reason}, {"lost_records", lost_}});
        if (std::fclose(std::exchange(file_, nullptr)) != 0) fail("cannot be written");
    }

private:
    using Record = nlohmann::ordered_json;

    std::filesystem::path path_, here_;
    std::string name_, version_;
    std::FILE* file_ = nullptr;
    int last_file_ = 0;
    Id station_ = 0;
    Parameters parameters_;
    Int seq_ = 0, transmissions_ = 0, lost_ = 0;
    Time last_at_ = 0;
    bool constant_ = true;   // timers last as long as the parameters say
    bool wanted_ = false;    // there is a station, and its log has not ended

    // An input and what followed from it, or a CAM, which is no input and follows from none.
    void write(const Step& step) {
        // The format has no null, no float, and no time that goes back.
        if (step.at < last_at_ || !(step.event == "receive" || is_plain(step.input))) {
            lost_ += 1 + static_cast<Int>(step.messages.size() + step.timers.size() + step.indications.size());
            return;
        }
        last_at_ = step.at;
        if (file_ == nullptr) open();
        if (step.event != "cam") {
            Record fields = step.event == "receive" ? received(step) : Record(step.input);
            fields["phase"] = step.phase;
            fields["role"] = step.role;
            put(step, step.event, fields);
        }
        for (const json& message : step.messages) {
            const std::string tx = std::to_string(station_) + ":" + std::to_string(++transmissions_);
            put(step, "send", {{"tx", tx}, {"message", message}});
        }
        for (const json& timer : step.timers) put(step, "timer", timer);
        for (const json& told : step.indications) put(step, "indication", {{"indication", told}});
    }

    // What the format cannot hold as a message stands there as bytes.
    static Record received(const Step& step) {
        const json& message = step.input["message"];
        const bool fits = message.is_object() && message.contains("type") && message["type"].is_string();
        if (!fits || !is_plain(message)) return {{"raw", base64(message.dump())}};
        Record fields{{"message", message}};
        if (message["type"] == "Advertisement" && step.input.contains("planned")) {
            fields["planned"] = step.input["planned"];
        }
        return fields;
    }

    static bool is_plain(const json& value) {
        if (value.is_structured()) return std::all_of(value.begin(), value.end(), is_plain);
        return value.is_string() || value.is_boolean() || value.is_number_integer();
    }

    static std::string base64(const std::string& bytes) {
        static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
        std::string text;
        for (std::size_t i = 0; i < bytes.size(); i += 3) {
            unsigned group = 0;
            for (std::size_t k = i; k < i + 3; ++k) {
                group = group << 8 | (k < bytes.size() ? static_cast<unsigned char>(bytes[k]) : 0u);
            }
            for (int shift = 18; shift >= 0; shift -= 6) text += digits[group >> shift & 63];
        }
        const std::size_t missing = (3 - bytes.size() % 3) % 3;
        return text.replace(text.size() - missing, missing, missing, '=');
    }

    Record told_parameters() const {
        const Parameters& p = parameters_;
        Record told{{"max_rounds", p.max_rounds}, {"max_participants", p.max_participants},
                    {"outbox_limit", p.outbox_limit}, {"memory_limit", p.memory_limit},
                    {"clock_drift", p.clock_drift}};
        if (constant_) {
            told.update({{"t_timeout", p.t_timeout}, {"t_resend", p.t_resend},
                         {"t_giveup", p.t_giveup()}, {"t_advertise", p.t_advertise()},
                         {"t_decide", p.t_decide}, {"t_hold", p.t_hold()},
                         {"t_life", p.t_life()}, {"t_cam_loss", p.t_cam_loss}});
        }
        return told;
    }

    // The name of the file names the run: nobody but this station is in it.
    void open() {
        do {
            here_ = path_;
            if (++last_file_ > 1) {
                here_.replace_filename(path_.stem().string() + "-" + std::to_string(last_file_)
                                       + path_.extension().string());
            }
            file_ = std::fopen(here_.c_str(), "wbx");
        } while (file_ == nullptr && errno == EEXIST);
        if (file_ == nullptr) fail("cannot be opened");
        put({{"rec", "header"},
             {"schema", "automcm.trace/1"},
             {"run", here_.stem().string()},
             {"station", station_},
             {"implementation", {{"name", name_}, {"version", version_}}},
             {"parameters", told_parameters()},
             {"complete", {"command", "indication", "receive", "restart", "send", "timer"}}});
    }

    void put(const Step& step, const std::string& event, const Record& fields) {
        Record record{{"rec", "event"}, {"seq", ++seq_}, {"t_ms", step.at}, {"ev", event}};
        record.update(fields);
        put(record);
    }

    void put(const Record& record) {
        const std::string line = record.dump(-1, ' ', false, Record::error_handler_t::replace) + "\n";
        if (std::fwrite(line.data(), 1, line.size(), file_) != line.size()) fail("cannot be written");
    }

    // A log with a hole in it would be worse than none.
    [[noreturn]] void fail(const char* what) const {
        std::fprintf(stderr, "%s %s: %s\n", here_.c_str(), what, std::strerror(errno));
        std::_Exit(3);
    }
};

}  // namespace automcm
