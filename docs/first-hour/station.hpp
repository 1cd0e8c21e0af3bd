#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

using nlohmann::json;
using Time = std::int64_t;

enum Which { decide, hold, cam, lease, give_up, resend, quarantine, forget };    // as in section 3

// A receiver: it joins sessions and opens none.
class Station {
public:
    Station(Time now, std::int64_t station_id, std::uint64_t /*seed*/, const json& parameters)
        : now_(now), me_(station_id), t_resend_(parameters.at("t_resend")),
          t_decide_(parameters.at("t_decide")), t_cam_loss_(parameters.at("t_cam_loss")),
          max_rounds_(parameters.at("max_rounds")) {
        const Time t_timeout = parameters.at("t_timeout");
        t_giveup_ = (1 + t_timeout / t_resend_) * t_resend_;
        t_life_ = 2 * t_giveup_;
    }

    // Fire due timers, by deadline and then in the order of section 3.
    void advance(Time now) {
        for (auto next = earliest(); next != timers_.end() && next->second <= now;
             next = earliest()) {
            const auto [which, of] = next->first;
            now_ = next->second;
            timers_.erase(next);
            expire(which, of);
        }
        now_ = now;
    }

    std::optional<Time> deadline() const {
        const auto next = earliest();
        return next == timers_.end() ? std::nullopt : std::optional(next->second);
    }

    // All messages and indications since the last answer.
    json answer() {
        const auto next = deadline();
        return {{"messages", std::exchange(messages_, json::array())},
                {"indications", std::exchange(indications_, json::array())},
                {"deadline", next ? json(*next) : json(nullptr)},
                {"phase", phase_}};
    }

    void receive(const json& message, const json& planned) {
        if (message.value("dst", me_) != me_) return;    // to another station (MSG-1)
        if (!well_formed(message)) return tell({{"name", "discarded"}});    // END-5
        const std::string type = message["type"];
        if (type == "CAM") return on_cam(message);
        if (breaks_the_protocol(message)) return tell({{"name", "discarded"}});
        if (type == "Advertisement") on_advertisement(message, planned);
        if (type == "Intention") on_intention(message);
        if (type == "Prescription") on_prescription(message);
        if (type == "Acceptance") on_acceptance(message);
        if (type == "Fin") on_fin(message);
        if (type == "Cancel") on_cancel(message);
        if (type == "Ack") on_ack(message);
    }

    void command(const std::string& name, const json& command) {
        const bool mine = command.value("session", json()) == session_;
        const bool answer = (name == "accept" || name == "refuse") && phase_ == "NEGOTIATING";
        if (name == "abort" && mine) return leave("abort");
        if (!mine || !answer || command.at("proposal") != proposal_)
            return tell({{"name", "refused"}});    // CMD-1, PRE-5
        if (name == "refuse") return refuse("unsafe");
        accept(command.at("selected"));
    }

private:
    using Timer = std::pair<Which, std::int64_t>;    // which, of what

    Time now_, t_giveup_ = 0, t_life_ = 0;
    std::int64_t me_;
    Time t_resend_, t_decide_, t_cam_loss_, lease_ = 0;
    std::int64_t max_rounds_;
    std::string phase_ = "STANDALONE";
    json session_ = json::array();
    std::int64_t proposal_ = 0;    // the newest seen in this session
    Time heard_ = -1;              // generation time of the last CAM that counted
    Time ahead_ = 0;               // by which the first one was ahead of our clock (ACT-5)
    std::int64_t seq_ = 0;         // of the last message in this session
    std::map<std::int64_t, std::pair<std::int64_t, Time>> joined_;    // number, time of joining
    std::map<Timer, Time> timers_;
    std::map<std::int64_t, json> outbox_;    // reliable messages, oldest first
    std::int64_t posted_ = 0;
    json messages_ = json::array(), indications_ = json::array();

    std::map<Timer, Time>::const_iterator earliest() const {
        return std::min_element(timers_.begin(), timers_.end(), [](const auto& a, const auto& b) {
            return std::pair(a.second, a.first) < std::pair(b.second, b.first);
        });
    }

    void start(Which which, Time duration, std::int64_t of = 0) {
        timers_[{which, of}] = now_ + duration;
    }

    void stop(Which which, std::int64_t of = 0) { timers_.erase({which, of}); }

    void tell(json indication) { indications_.push_back(std::move(indication)); }

    // Send a message once.  With seq 0 it is an answer.
    json send(const char* type, const json& to, const json& session, std::int64_t seq,
              const json& fields) {
        json message = {{"v", 1}, {"type", type}, {"src", me_},
                        {"dst", to}, {"session", session}, {"seq", seq}};
        message.update(fields);
        messages_.push_back(message);
        return message;
    }

    void reply(const char* type, const json& to, const json& fields) {
        send(type, to.at("src"), to.at("session"), 0, fields);
    }

    void ack(const json& message) {
        reply("Ack", message, {{"of", {{"type", message["type"]}, {"seq", message["seq"]}}}});
    }

    // Send to the prescriber reliably: every t_resend, until the Ack or the give-up.
    void post(const char* type, const json& fields) {
        outbox_[++posted_] = send(type, session_[0], session_, ++seq_, fields);
        start(give_up, t_giveup_, posted_);
        start(resend, t_resend_, posted_);
    }

    void drop_one(std::int64_t n) {
        outbox_.erase(n);
        stop(give_up, n);
        stop(resend, n);
    }

    // Stop sending all messages but Cancels.
    void drop() {
        std::vector<std::int64_t> over;
        for (const auto& [n, message] : outbox_)
            if (message["type"] != "Cancel") over.push_back(n);
        for (const auto n : over) drop_one(n);
    }

    // No required field is missing or null, and the type is known.
    static bool well_formed(const json& message) {
        static const std::map<std::string, std::vector<const char*>> fields = {
            {"Advertisement", {"session", "seq", "scenario", "details"}},
            {"Intention", {"session", "seq", "planned"}},
            {"Prescription", {"session", "seq", "proposal", "prescribed", "hold_ms", "lease_ms"}},
            {"Acceptance", {"session", "seq", "proposal", "accepted"}},
            {"Fin", {"session", "seq"}},
            {"Cancel", {"session", "seq", "reason"}},
            {"Ack", {"session", "seq", "of"}},
            {"CAM", {"generation_ms", "marks"}}};
        const auto found = fields.find(message.value("type", ""));
        if (found == fields.end() || !message.contains("src")) return false;
        return std::all_of(found->second.begin(), found->second.end(), [&](const char* field) {
            return message.contains(field) && !message[field].is_null();
        });
    }

    // END-5: no conforming station sends this.
    bool breaks_the_protocol(const json& message) const {
        const std::string type = message["type"];
        const json &source = message["src"], &prescriber = message["session"][0];
        const bool of_prescriber = type == "Advertisement" || type == "Prescription" ||
                                   message.value("reason", "") == "closed";
        const bool to_prescriber = type == "Intention" || type == "Acceptance";
        return source == me_ || message.contains("dst") == (type == "Advertisement") ||
               (of_prescriber && source != prescriber) || (to_prescriber && prescriber != me_) ||
               (type == "Prescription" && message["proposal"] > max_rounds_);
    }

    void on_advertisement(const json& message, const json& planned) {
        const std::int64_t prescriber = message["session"][0], number = message["session"][1];
        const bool known = joined_.count(prescriber) && joined_[prescriber].first >= number;
        const bool quarantined = timers_.count({quarantine, 0}) != 0;
        if (phase_ != "STANDALONE" || quarantined || known || planned.is_null())
            return;    // ADV-4, ACT-6, ADV-8, ADV-3
        session_ = message["session"];
        phase_ = "INTENDING";
        seq_ = proposal_ = 0;
        heard_ = -1;
        joined_[prescriber] = {number, now_};
        stop(forget, prescriber);
        post("Intention", {{"planned", planned}});
    }

    void wait() {
        phase_ = "WAITING";
        start(hold, 3 * t_giveup_ + t_decide_);
    }

    void on_prescription(const json& message) {
        const std::int64_t proposal = message["proposal"];
        if (message["session"] != session_) {    // NEG-4, NEG-5
            const char* why = phase_ == "STANDALONE" ? "unknown_session" : "busy";
            reply("Acceptance", message,
                  {{"proposal", proposal}, {"accepted", false}, {"reason", why}});
        } else if (proposal <= proposal_) {
            ack(message);
        } else if (phase_ == "NEGOTIATING" || phase_ == "ACTUATING") {
            tell({{"name", "discarded"}});
        } else {    // NEG-1
            for (const auto& [n, sent] : std::map(outbox_))
                if (sent["type"] == "Intention") drop_one(n);
            stop(hold);
            phase_ = "NEGOTIATING";
            proposal_ = proposal;
            lease_ = message["lease_ms"];
            start(decide, t_decide_);
            ack(message);
            tell({{"name", "verify"}, {"session", session_}, {"proposal", proposal},
                  {"prescribed", message["prescribed"]}});
        }
    }

    // NEG-2: from now on the station is committed.
    void accept(const json& selected) {
        stop(decide);
        phase_ = "ACTUATING";
        start(cam, t_cam_loss_);
        start(lease, lease_);
        post("Acceptance",
             {{"proposal", proposal_}, {"accepted", true}, {"selected", selected}});
    }

    void refuse(const char* why) {    // NEG-3
        stop(decide);
        post("Acceptance", {{"proposal", proposal_}, {"accepted", false}, {"reason", why}});
        wait();
    }

    // ACT-5: a CAM counts if it is from the prescriber, newer, not too far ahead, and names the session.
    void on_cam(const json& message) {
        if (phase_ != "ACTUATING" || message["src"] != session_[0]) return;
        const json& marks = message["marks"];
        const Time generated = message["generation_ms"];
        if (std::find(marks.begin(), marks.end(), session_) == marks.end()) return;
        if (heard_ < 0) ahead_ = generated - now_;
        if (generated <= heard_ || generated > now_ + ahead_ + 4 * t_resend_) return;
        heard_ = generated;
        start(cam, t_cam_loss_);
    }

    // END-1: leave; with a reason, send a Cancel.
    void leave(const std::string& why) {
        drop();
        if (!why.empty()) post("Cancel", {{"reason", why}});
        if (!why.empty() && phase_ == "ACTUATING")    // ACT-6: its prescriber may act for this long
            start(quarantine, std::max(t_giveup_ + t_life_, t_cam_loss_ + t_resend_ / 2));
        for (const Which which : {decide, hold, cam, lease}) stop(which);
        const std::int64_t prescriber = session_[0];
        const Time may_go = joined_[prescriber].second + t_giveup_ + t_life_;    // ADV-8
        timers_[{forget, prescriber}] = std::max(may_go, now_ + t_life_);
        phase_ = "STANDALONE";
        session_ = json::array();
    }

    void fall_back(const std::string& reason, bool cancel) {
        tell({{"name", "fallback"}, {"session", session_}, {"reason", reason}});
        leave(cancel ? reason : "");
    }

    bool of_my_prescriber(const json& message) const {
        return message["session"] == session_ && message["src"] == session_[0];
    }

    void on_fin(const json& message) {
        ack(message);
        if (!of_my_prescriber(message)) return;
        tell({{"name", "finished"}, {"session", session_}});    // ACT-3
        leave("");
    }

    void on_cancel(const json& message) {
        if (message["seq"] != 0) ack(message);
        if (of_my_prescriber(message)) fall_back(message["reason"], false);    // END-2
    }

    // END-6: an Ack counts only for the message that it names.
    void on_ack(const json& message) {
        for (const auto& [n, sent] : std::map(outbox_)) {
            if (message["src"] != sent["dst"] || message["session"] != sent["session"] ||
                message["of"]["type"] != sent["type"] || message["of"]["seq"] != sent["seq"])
                continue;
            drop_one(n);
            if (sent["type"] == "Intention") wait();    // ADV-6
        }
    }

    // ADV-5, NEG-6: for a session of this station, which opens none.
    void on_intention(const json& message) { reply("Cancel", message, {{"reason", "closed"}}); }

    void on_acceptance(const json& message) {
        if (message["accepted"])
            reply("Cancel", message, {{"reason", "closed"}});
        else if (message["seq"] != 0)
            ack(message);
    }

    void expire(Which which, std::int64_t of) {
        if (which == resend) {
            messages_.push_back(outbox_[of]);
            start(resend, t_resend_, of);
        } else if (which == give_up) {
            const bool intention = outbox_[of]["type"] == "Intention";
            drop_one(of);
            if (intention) wait();    // ADV-6; the others change nothing
        } else if (which == decide) {
            tell({{"name", "undecided"}, {"session", session_}, {"proposal", proposal_}});
            refuse("undecided");
        } else if (which == hold) {
            fall_back("timeout", false);    // ADV-7
        } else if (which == forget) {
            joined_.erase(of);
        } else if (which != quarantine) {
            fall_back(which == cam ? "cam_loss" : "lease_expired", true);    // ACT-2, ACT-4
        }
    }
};
