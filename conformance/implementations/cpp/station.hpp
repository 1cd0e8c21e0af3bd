// A station of the AutoMCM protocol, without input or output of its own.
//
// Messages, commands and the time come in through five functions, and what they bring about comes
// out as their result. The rules are those of docs/protocol.md; their ids stand beside the code.
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <optional>
#include <random>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "messages.hpp"

namespace automcm {

using Time = std::int64_t;                // milliseconds
using Session = std::pair<Id, Int>;       // its prescriber and its number

struct Parameters {
    Time t_timeout = 2000, t_resend = 100, t_decide = 500, t_cam_loss = 1500, t_cam = 100;
    Time backoff_min = 500, backoff_max = 2000;
    Int max_rounds = 3, max_participants = 32, outbox_limit = 64, memory_limit = 64;
    Int clock_drift = 1;                  // percent; 0: all clocks run alike

    // What follows from them (section 3).
    Time t_giveup() const { return (1 + t_timeout / t_resend) * t_resend; }
    Time t_advertise() const { return t_giveup(); }
    Time t_hold() const { return t_advertise() + t_decide + 2 * t_giveup(); }
    Time t_life() const { return 2 * t_giveup(); }

    // How long a prescriber's lease lasts: its clock may be slower than its target's (ACT-4).
    Time own_lease(Time lease_ms) const {
        if (clock_drift == 0) return lease_ms;
        return std::max<Time>(1, lease_ms - (lease_ms * clock_drift + 99) / 100 - 1);
    }

    // How far a CAM may be ahead of the first one that counted, so long after it (ACT-5).
    Time cam_lead(Time elapsed) const {
        return elapsed + (elapsed * clock_drift + 99) / 100 + 4 * t_resend;
    }
};

enum class Phase {
    standalone, advertising, choosing, prescribing, negotiating, actuating, intending, waiting
};

// In the order of the table in section 3: with equal deadlines the upper one fires first.
enum class Timer {
    advertise, resend_advertisement, decide, hold, answer, cam, lease, giveup, resend, quarantine,
    forget, backoff
};

// What happened at one moment, for a log: an input with what followed from it, or a CAM.
struct Step {
    Time at = 0;
    std::string event;      // receive, command, restart, timer (one that expired); cam
    json input;             // message and planned; command; op and timer
    json::array_t messages, timers, indications;
    const char* phase = ""; // after it, as the role
    const char* role = "";
};

struct Output {
    json::array_t messages, indications, cams;
    std::vector<Step> steps;    // the same in the order in which it happened, if it is kept
};

class Station {
public:
    Station(Id id, const Parameters& parameters, std::uint64_t seed, Time now)
        : id_(id), p_(parameters), random_(seed), now_(now), next_cam_(now + parameters.t_cam) {
        if (p_.t_resend < 1 || p_.t_cam < 1 || p_.backoff_min > p_.backoff_max) {
            throw std::invalid_argument("these parameters make no station");
        }
    }

    // `planned` is there if the message is an Advertisement that concerns the application (ADV-3).
    Output receive(const json& message, const json* planned, Time now) {
        pass_time(now);
        if (keeps_steps_) {
            begin_step("receive", {{"message", message}});
            if (planned != nullptr) step_->input["planned"] = *planned;
        }
        if (is_for_another(message)) return take_output();                          // MSG-1
        if (const char* fault = fault_of(message)) {                                // END-5
            out_.indications.push_back({{"name", "discarded"}, {"rule", "END-5"}, {"detail", fault}});
            return take_output();
        }
        const std::string& type = message["type"].get_ref<const std::string&>();
        if (type == "Advertisement") on_advertisement(message, planned);
        else if (type == "Intention") on_intention(message);
        else if (type == "Prescription") on_prescription(message);
        else if (type == "Acceptance") on_acceptance(message);
        else if (type == "Fin") on_fin(message);
        else if (type == "Cancel") on_cancel(message);
        else if (type == "Ack") on_ack(message);
        else on_cam(message);
        return take_output();
    }

    // The caller has looked the name up in command_fields().
    Output command(const json& command, Time now) {
        pass_time(now);
        if (keeps_steps_) begin_step("command", {{"command", command}});
        if (const char* refusal = carry_out(command)) {
            out_.indications.push_back({{"name", "refused"}, {"detail", refusal}});
        }
        return take_output();
    }

    Output advance(Time now) {
        pass_time(now);
        return take_output();
    }

    // END-8: no memory is left but the last session number. What was due is lost with the timers.
    Output restart(Time now) {
        send_cams_before(now);
        now_ = now;
        if (keeps_steps_) {
            begin_step("restart", json::object());
            for (const auto& [timer, deadline] : timers_) note_timer("stop", timer);
        }
        phase_ = Phase::standalone;
        own_ = Own{};
        outbox_.clear();
        joined_.clear();
        timers_.clear();
        enter_quarantine();
        return take_output();
    }

    // From now on timers of this name last so long, whatever the parameters say.
    static bool is_timer(const std::string& name) { return !timers_called(name).empty(); }
    void set_duration(const std::string& name, Time lasts) {
        for (Timer timer : timers_called(name)) durations_[timer] = lasts;
    }

    // From now on Output has the steps.
    void keep_steps() { keeps_steps_ = true; }

    Id id() const { return id_; }
    const Parameters& parameters() const { return p_; }

    std::optional<Time> deadline() const {
        const auto timer = next_timer();
        if (timer == timers_.end()) return std::nullopt;
        return timer->second;
    }

    const char* role() const {
        return is_prescriber() ? "prescriber" : is_receiver() ? "receiver" : "none";
    }

    const char* phase() const {
        static const char* const names[] = {"STANDALONE", "ADVERTISING", "CHOOSING", "PRESCRIBING",
                                            "NEGOTIATING", "ACTUATING", "INTENDING", "WAITING"};
        return names[static_cast<int>(phase_)];
    }

    // The sessions that a CAM names: the own one and those whose Fin is not acknowledged (ACT-5).
    std::set<Session> marks() const {
        std::set<Session> marks;
        if (bound()) marks.insert(own_.session);
        for (const auto& [age, message] : outbox_) {
            if (message["type"] == "Fin") marks.insert(message["session"].get<Session>());
        }
        return marks;
    }

private:
    using TimerId = std::pair<Timer, Int>;   // the second: the age of a message or a prescriber

    // What belongs to the session that the station is bound to, and goes when it leaves.
    struct Own {
        Session session{};
        Id peer = 0;                  // 0: a prescriber that has no target yet
        Int seq = 0;                  // the last one given
        Int proposal = 0;             // the newest one sent or seen
        Time lease_ms = 0;            // of that proposal
        Int last_cam = -1;            // generation time of the last CAM that counted
        Int first_cam = -1;           // that of the first one
        Time first_cam_at = 0;        // when it was received
        Time joined_at = 0;
        std::map<Id, json> recorded;  // what each recorded station plans
        std::set<Id> withdrawn;
        json advertisement;
    };

    Id id_;
    Parameters p_;
    std::mt19937_64 random_;
    Time now_;
    Time next_cam_;
    Int last_number_ = 0;                // of the own sessions
    Phase phase_ = Phase::standalone;
    Own own_;
    Int last_age_ = 0;
    std::map<Int, json> outbox_;         // by age, the oldest message first
    std::map<Id, Int> joined_;           // by prescriber: the highest number joined (ADV-8)
    std::map<TimerId, Time> timers_;     // in the order of the table
    std::map<Timer, Time> durations_;    // those set from outside
    Output out_;
    bool keeps_steps_ = false;
    std::optional<Step> step_;           // the one that goes on
    std::size_t sent_before_ = 0, told_before_ = 0;

    bool bound() const { return phase_ != Phase::standalone; }
    bool is_prescriber() const { return bound() && own_.session.first == id_; }
    bool is_receiver() const { return bound() && own_.session.first != id_; }
    bool in_session(const json& message) const {                                    // END-4
        return bound() && is_own(message["session"]);
    }
    bool is_own(const json& session) const {
        return session[0] == own_.session.first && session[1] == own_.session.second;
    }
    Output take_output() {
        end_step();
        return std::exchange(out_, Output{});
    }

    // MEM-1: a prescriber needs an entry for each participant, a receiver one for each round, and
    // either one more to end the session.
    bool room() const {
        return static_cast<Int>(outbox_.size()) + 1 + std::max(p_.max_participants, p_.max_rounds)
               <= p_.outbox_limit;
    }

    // ------------------------------------------------------------------------------------ timers

    void arm(Timer timer, Time lasts, Int of = 0) {
        const auto set = durations_.find(timer);
        if (set != durations_.end()) lasts = set->second;
        timers_[{timer, of}] = now_ + std::max<Time>(1, lasts);
        note_timer("arm", {timer, of});
    }
    void stop(Timer timer, Int of = 0) {
        if (timers_.erase({timer, of}) > 0) note_timer("stop", {timer, of});
    }
    bool armed(Timer timer) const { return timers_.count({timer, 0}) > 0; }

    static std::vector<Timer> timers_called(const std::string& name) {
        static const std::map<std::string, std::vector<Timer>> names{
            {"advertise", {Timer::advertise}},   {"decide", {Timer::decide}},
            {"resend", {Timer::resend_advertisement, Timer::resend}},
            {"hold", {Timer::hold}},             {"answer", {Timer::answer}},
            {"cam", {Timer::cam}},               {"giveup", {Timer::giveup}},
            {"quarantine", {Timer::quarantine}}, {"forget", {Timer::forget}},
            {"backoff", {Timer::backoff}}};
        const auto found = names.find(name);
        return found == names.end() ? std::vector<Timer>{} : found->second;
    }

    // The first of the earliest: the map has them in the order in which they are to fire.
    std::map<TimerId, Time>::const_iterator next_timer() const {
        return std::min_element(timers_.begin(), timers_.end(), [](const auto& one, const auto& other) {
            return one.second < other.second;
        });
    }

    // Fires what is due; what a late timer arms lasts from now. CAMs have the marks of their own time.
    void pass_time(Time now) {
        now_ = now;
        for (auto timer = next_timer(); timer != timers_.end() && timer->second <= now;
             timer = next_timer()) {
            const auto [id, deadline] = *timer;
            send_cams_before(deadline);
            timers_.erase(timer);
            if (keeps_steps_) begin_step("timer", {{"op", "expire"}, {"timer", described(id)}});
            fire(id.first, id.second);
            end_step();
        }
        send_cams_before(now + 1);
    }

    void fire(Timer timer, Int of) {
        switch (timer) {
            case Timer::advertise: on_advertise_end(); break;
            case Timer::resend_advertisement: broadcast_advertisement(); break;
            case Timer::decide: on_decide(); break;
            case Timer::hold:                                                       // ADV-7
                indicate("fallback", {{"reason", "timeout"}});
                leave();
                break;
            case Timer::answer: fall_back("timeout"); break;                        // NEG-8
            case Timer::cam: fall_back("cam_loss"); break;                          // ACT-2
            case Timer::lease: fall_back("lease_expired"); break;                   // ACT-4
            case Timer::giveup: on_giveup(of); break;
            case Timer::resend: send_again(of); break;
            case Timer::quarantine: break;       // that it is not armed is all that counts (END-8, ACT-6)
            case Timer::forget: joined_.erase(of); break;                           // ADV-8
            case Timer::backoff: break;                                             // END-7
        }
    }

    // ----------------------------------------------------------------------- what a log is told of

    void begin_step(const char* event, json input) {
        step_ = Step{now_, event, std::move(input), {}, {}, {}};
        sent_before_ = out_.messages.size();
        told_before_ = out_.indications.size();
    }

    void end_step() {
        if (!step_) return;
        const auto later = [](const json::array_t& all, std::size_t before) {
            return json::array_t(all.begin() + static_cast<std::ptrdiff_t>(before), all.end());
        };
        step_->messages = later(out_.messages, sent_before_);
        step_->indications = later(out_.indications, told_before_);
        step_->phase = phase();
        step_->role = role();
        out_.steps.push_back(std::move(*step_));
        step_.reset();
    }

    void note_timer(const char* op, const TimerId& id) {
        if (!step_) return;
        json change{{"op", op}, {"timer", described(id)}};
        if (op == std::string("arm")) change["deadline"] = timers_.at(id);
        step_->timers.push_back(std::move(change));
    }

    // A timer as a log names it.
    json described(const TimerId& id) const {
        static const char* const names[] = {"advertise", "resend", "decide", "hold", "answer", "cam",
                                            "lease", "giveup", "resend", "quarantine", "forget", "backoff"};
        const auto [timer, of] = id;
        json described{{"name", names[static_cast<int>(timer)]}};
        if (timer == Timer::forget) described["station"] = of;
        const bool of_entry = timer == Timer::giveup || timer == Timer::resend;
        if (of_entry || timer == Timer::resend_advertisement) {
            const json& message = of_entry ? outbox_.at(of) : own_.advertisement;
            json& about = described["message"] = {{"type", message["type"]}, {"session", message["session"]},
                                                  {"seq", message["seq"]}};
            if (of_entry) about["to"] = message["dst"];
        }
        return described;
    }

    // ------------------------------------------------------------------------------ what goes out

    json make(const char* type, const json& session, Int seq, json fields) const {
        fields["v"] = 1;
        fields["type"] = type;
        fields["src"] = id_;
        fields["session"] = session;
        fields["seq"] = seq;
        return fields;
    }

    // A new reliable message of the own session (REL-1).
    void post(const char* type, Id dst, json fields = json::object()) {
        fields["dst"] = dst;
        const Int age = ++last_age_;
        outbox_[age] = make(type, own_.session, ++own_.seq, std::move(fields));
        out_.messages.push_back(outbox_[age]);
        arm(Timer::giveup, p_.t_giveup(), age);
        arm(Timer::resend, p_.t_resend, age);
    }

    void send_again(Int age) {
        out_.messages.push_back(outbox_.at(age));
        arm(Timer::resend, p_.t_resend, age);
    }

    void drop(Int age) {
        stop(Timer::giveup, age);
        stop(Timer::resend, age);
        outbox_.erase(age);
    }

    // Only the own session has entries of these types, for leaving ends their sending (END-1).
    void stop_sending(Texts types) {
        for (auto entry = outbox_.begin(); entry != outbox_.end();) {
            const Int age = entry->first;
            const json& type = (entry++)->second["type"];
            if (is_one_of(type, types)) drop(age);
        }
    }

    // Sent once, with seq 0, to where the message came from and in the session of that message.
    void answer(const char* type, const json& message, json fields) {
        fields["dst"] = message["src"];
        out_.messages.push_back(make(type, message["session"], 0, std::move(fields)));
    }

    void ack(const json& message) {
        answer("Ack", message, {{"of", {{"type", message["type"]}, {"seq", message["seq"]}}}});
    }

    // ADV-5, NEG-6: the session is over for the sender. The copy touches no timer of the entry.
    void answer_closed(const json& message) {
        for (const auto& [age, entry] : outbox_) {
            if (is_one_of(entry["type"], {"Fin", "Cancel"}) && entry["dst"] == message["src"]
                && entry["session"] == message["session"]) {
                out_.messages.push_back(entry);
                return;
            }
        }
        answer("Cancel", message, {{"reason", "closed"}});
    }

    void broadcast_advertisement() {                                                // ADV-2
        out_.messages.push_back(own_.advertisement);
        arm(Timer::resend_advertisement, p_.t_resend);
    }

    void indicate(const char* name, json fields = json::object()) {
        fields["name"] = name;
        fields["session"] = own_.session;
        out_.indications.push_back(std::move(fields));
    }

    // ACT-2. The station knows no position; in a vehicle the sender would fill it in.
    void send_cams_before(Time end) {
        // After a leap of many minutes only the last CAMs are of use to anybody.
        constexpr Time most = 5000;
        if (next_cam_ < end) next_cam_ += std::max<Time>(0, (end - next_cam_) / p_.t_cam - most) * p_.t_cam;
        if (next_cam_ >= end) return;
        const json marks = this->marks();
        for (; next_cam_ < end; next_cam_ += p_.t_cam) {
            out_.cams.push_back({{"v", 1}, {"type", "CAM"}, {"src", id_}, {"generation_ms", next_cam_},
                                 {"x_mm", 0}, {"y_mm", 0}, {"heading_mrad", 0}, {"speed_mm_s", 0},
                                 {"marks", marks}});
            if (keeps_steps_) out_.steps.push_back({next_cam_, "cam", json::object(), {out_.cams.back()}, {}, {}});
        }
    }

    // ---------------------------------------------------------------- steps that more rules share

    void enter_waiting() {                                                          // ADV-6, NEG-3
        phase_ = Phase::waiting;
        arm(Timer::hold, p_.t_hold());
    }

    void enter_actuating() {                                                        // NEG-2, NEG-6
        phase_ = Phase::actuating;
        arm(Timer::cam, p_.t_cam_loss);
    }

    // END-1: Fin and Cancel go on being sent, all else of the session ends here.
    void leave() {
        for (Timer timer : {Timer::advertise, Timer::resend_advertisement, Timer::decide,
                            Timer::hold, Timer::answer, Timer::cam, Timer::lease}) {
            stop(timer);
        }
        stop_sending({"Intention", "Prescription", "Acceptance"});
        if (is_receiver()) {                                                        // ADV-8
            const Time until = std::max(own_.joined_at + p_.t_advertise(), now_) + p_.t_life();
            arm(Timer::forget, until - now_, own_.session.first);
        }
        phase_ = Phase::standalone;
        own_ = Own{};
    }

    // END-8, ACT-6: it joins and requests nothing while somebody may act on its word.
    void enter_quarantine() {
        const Time acts_on = p_.t_cam_loss + p_.t_resend / 2;
        arm(Timer::quarantine, std::max(p_.t_advertise() + p_.t_life(), acts_on));
    }

    // A Cancel to the peer, before the choice to every recorded station (END-1); then out.
    void cancel_and_leave(const char* reason) {
        if (is_receiver() && phase_ == Phase::actuating) enter_quarantine();        // ACT-6
        if (own_.peer != 0) post("Cancel", own_.peer, {{"reason", reason}});
        for (const auto& [station, planned] : own_.recorded) post("Cancel", station, {{"reason", reason}});
        leave();
    }

    // The same where it is not the application that wants it, so that it has to be told.
    void fall_back(const char* reason) {
        indicate("fallback", {{"reason", reason}});
        cancel_and_leave(reason);
    }

    void no_participants() {                                                        // PRE-1, END-7
        indicate("no_participants");
        leave();
        const auto span = static_cast<std::uint64_t>(p_.backoff_max - p_.backoff_min + 1);
        arm(Timer::backoff, p_.backoff_min + static_cast<Time>(random_() % span));
    }

    void refuse_proposal(const char* reason) {                                      // NEG-3
        stop(Timer::decide);
        post("Acceptance", own_.peer,
             {{"proposal", own_.proposal}, {"accepted", false}, {"reason", reason}});
        enter_waiting();
    }

    // A prescriber in NEGOTIATING waits for its target or for its application: the timers tell.
    bool awaits_answer() const { return phase_ == Phase::prescribing || armed(Timer::answer); }
    bool awaits_proposal() const {
        return phase_ == Phase::choosing
               || (is_prescriber() && phase_ == Phase::negotiating && armed(Timer::decide));
    }

    // --------------------------------------------------------------------------- timers that expire

    void on_advertise_end() {                                                       // PRE-1
        if (own_.recorded.empty()) return no_participants();
        stop(Timer::resend_advertisement);
        own_.withdrawn.clear();                                                     // ADV-5
        phase_ = Phase::choosing;
        arm(Timer::decide, p_.t_decide);
        json stations = json::array(), intentions = json::array();
        for (const auto& [station, planned] : own_.recorded) {
            stations.push_back(station);
            intentions.push_back({{"station", station}, {"planned", planned}});
        }
        indicate("choose", {{"stations", stations}, {"intentions", intentions}});
    }

    void on_decide() {
        if (is_prescriber()) return fall_back("abort");                             // PRE-5
        indicate("undecided", {{"proposal", own_.proposal}});                       // NEG-3
        refuse_proposal("undecided");
    }

    void on_giveup(Int age) {
        const json type = outbox_.at(age)["type"];
        drop(age);
        if (type == "Intention") enter_waiting();                                   // ADV-6
        if (type == "Prescription") fall_back("timeout");                           // PRE-4
        // Acceptance: the commitment stays (NEG-9). Fin, Cancel: nothing more (REL-1).
    }

    // ---------------------------------------------------------------------------- messages received

    // MSG-1 comes before all else, so the message may be malformed in any way but its dst.
    bool is_for_another(const json& message) const {
        if (!message.is_object()) return false;
        const auto dst = message.find("dst");
        return dst != message.end() && is_station(*dst) && dst->get<Id>() != id_;
    }

    // END-5: why the message breaks the protocol, or null.
    const char* fault_of(const json& message) const {
        if (!is_well_formed(message)) return "malformed";
        const json& type = message["type"];
        const Id src = message["src"];
        if (src == id_) return "an echo of the own message";
        if (type == "CAM") return nullptr;
        const Id prescriber = message["session"][0];
        if ((type == "Advertisement" || type == "Prescription") && src != prescriber) {
            return "not from the prescriber of the session";
        }
        if (type == "Prescription" && message["proposal"] > p_.max_rounds) return "after the last round";
        if ((type == "Intention" || type == "Acceptance") && prescriber != id_) {
            return "not a session of this station";
        }
        if (type == "Cancel" && message["reason"] == "closed" && src != prescriber) {
            return "closed by somebody else";
        }
        if (!in_session(message)) return nullptr;
        if (type == "Acceptance") {
            if (src != own_.peer) return "not from the target";
            if (message["proposal"] > own_.proposal) return "a proposal not yet sent";
        }
        if (type == "Prescription" && message["proposal"] > own_.proposal) {
            const bool turn = phase_ == Phase::intending || phase_ == Phase::waiting;
            if (!turn) return "a proposal out of turn";
        }
        return nullptr;
    }

    void on_advertisement(const json& message, const json* planned) {
        const Session session = message["session"];
        if (bound()) return;                                                        // ADV-4
        if (planned == nullptr) return;                                             // ADV-3
        if (armed(Timer::quarantine)) return;                                       // END-8
        const auto joined = joined_.find(session.first);
        if (joined != joined_.end() && session.second <= joined->second) return;    // ADV-8
        const bool full = static_cast<Int>(joined_.size()) >= p_.memory_limit;
        if ((joined == joined_.end() && full) || !room()) return;                   // MEM-1

        own_.session = session;
        own_.peer = session.first;
        own_.joined_at = now_;
        joined_[session.first] = session.second;
        stop(Timer::forget, session.first);    // the entry is kept while the station is in a session
        phase_ = Phase::intending;
        post("Intention", own_.peer, {{"planned", *planned}});
    }

    void on_intention(const json& message) {                                        // ADV-5
        const Id src = message["src"];
        if (!in_session(message)) return answer_closed(message);
        if (own_.recorded.count(src) > 0 || src == own_.peer) return ack(message);
        if (phase_ != Phase::advertising || own_.withdrawn.count(src) > 0) return answer_closed(message);
        if (!room_for_participant()) return;                                        // MEM-1
        own_.recorded[src] = message["planned"];
        ack(message);
    }

    bool room_for_participant() const {                                             // MEM-1
        return static_cast<Int>(own_.recorded.size() + own_.withdrawn.size()) < p_.max_participants;
    }

    void on_prescription(const json& message) {
        const json& proposal = message["proposal"];
        if (!in_session(message)) {
            const char* reason = bound() ? "busy" : "unknown_session";              // NEG-4, NEG-5
            return answer("Acceptance", message,
                          {{"proposal", proposal}, {"accepted", false}, {"reason", reason}});
        }
        ack(message);
        if (proposal <= own_.proposal) return;                                      // NEG-1: a copy
        own_.proposal = proposal;
        own_.lease_ms = message["lease_ms"];
        stop_sending({"Intention"});                                                // ADV-6
        stop(Timer::hold);
        phase_ = Phase::negotiating;
        arm(Timer::decide, p_.t_decide);
        indicate("verify", {{"proposal", proposal}, {"prescribed", message["prescribed"]},
                            {"hold_ms", message["hold_ms"]}, {"lease_ms", own_.lease_ms}});
    }

    void on_acceptance(const json& message) {                                       // NEG-6
        const bool accepted = message["accepted"];
        const bool reliable = message["seq"] != 0;
        if (!in_session(message)) {
            if (accepted) answer_closed(message);
            else if (reliable) ack(message);
            return;
        }
        if (reliable) ack(message);
        if (!awaits_answer()) return;
        if (message["proposal"] != own_.proposal) return;
        stop_sending({"Prescription"});                                             // PRE-4
        stop(Timer::answer);
        if (accepted) take_acceptance(message);
        else take_refusal(message);
    }

    void take_acceptance(const json& message) {                                     // NEG-6
        enter_actuating();
        indicate("accepted", {{"proposal", own_.proposal}, {"selected", message["selected"]},
                              {"lease_left_ms", timers_.at({Timer::lease, 0}) - now_}});
    }

    void take_refusal(const json& message) {                                        // NEG-7
        if (is_answer(message) || own_.proposal >= p_.max_rounds) return fall_back("no_agreement");
        phase_ = Phase::negotiating;
        stop(Timer::lease);
        arm(Timer::decide, p_.t_decide);
        indicate("propose", {{"proposal", own_.proposal + 1}, {"reason", message["reason"]}});
    }

    void on_fin(const json& message) {
        ack(message);                                                               // END-3
        if (!in_session(message) || !is_receiver() || message["src"] != own_.peer) return;
        indicate("finished");                                                       // ACT-3
        leave();
    }

    void on_cancel(const json& message) {
        const Id src = message["src"];
        if (message["seq"] != 0) ack(message);                                      // END-3
        if (!in_session(message)) return;
        if (phase_ == Phase::advertising) return withdraw(src);
        if (phase_ == Phase::choosing) {                                            // END-2
            if (own_.recorded.erase(src) > 0 && own_.recorded.empty()) no_participants();
            return;
        }
        if (src != own_.peer) return;
        indicate("fallback", {{"reason", message["reason"]}});                      // END-2
        leave();
    }

    void withdraw(Id station) {                                                     // END-2
        if (own_.recorded.count(station) == 0 && !room_for_participant()) return;   // MEM-1
        own_.recorded.erase(station);
        own_.withdrawn.insert(station);
    }

    void on_ack(const json& message) {                                              // END-6
        const json& of = message["of"];
        for (const auto& [age, entry] : outbox_) {
            if (entry["dst"] == message["src"] && entry["session"] == message["session"]
                && entry["type"] == of["type"] && entry["seq"] == of["seq"]) {
                return on_acknowledged(age);
            }
        }
    }

    void on_acknowledged(Int age) {
        const json type = outbox_.at(age)["type"];
        drop(age);
        if (type == "Intention") enter_waiting();                                   // ADV-6
        if (type == "Prescription") {                                               // PRE-4
            phase_ = Phase::negotiating;
            arm(Timer::answer, p_.t_decide + p_.t_giveup());
        }
    }

    void on_cam(const json& message) {                                              // ACT-5
        if (phase_ != Phase::actuating || message["src"] != own_.peer) return;
        const json& marks = message["marks"];
        const auto own = [this](const json& mark) { return is_own(mark); };
        if (std::none_of(marks.begin(), marks.end(), own)) return;
        const Int generated = message["generation_ms"];
        if (own_.first_cam < 0) {
            own_.first_cam = generated;
            own_.first_cam_at = now_;
        }
        const Int latest = own_.first_cam + p_.cam_lead(now_ - own_.first_cam_at);
        if (generated <= own_.last_cam || generated > latest) return;
        own_.last_cam = generated;
        arm(Timer::cam, p_.t_cam_loss);
    }

    // -------------------------------------------------------------------- commands of the application

    // Why the command is refused, or null if it was carried out. What refuses changes nothing.
    const char* carry_out(const json& command) {
        const std::string& name = command.at("name").get_ref<const std::string&>();
        if (!has_fields(command, command_fields().at(name), true)) return "CMD-1: a field is wrong";
        if (name == "request") return request(command);
        if (!bound()) return "CMD-1: there is no session";
        if (!is_own(command["session"])) return "PRE-5: another session";
        if (name == "prescribe") return prescribe(command);
        if (name == "close") return close();
        if (name == "proceed") return proceed();
        if (name == "accept") return accept(command);
        if (name == "refuse") return refuse(command);
        if (name == "complete") return complete();
        cancel_and_leave("abort");                                                  // END-1
        return nullptr;
    }

    const char* request(const json& command) {                                      // ADV-1
        if (bound()) return "ADV-1: already in a session";
        if (armed(Timer::quarantine)) return "ACT-6: in quarantine";
        if (armed(Timer::backoff)) return "END-7: backing off";
        if (!room()) return "MEM-1: the outbox is full";
        own_.session = {id_, ++last_number_};
        json fields{{"scenario", command["scenario"]}, {"details", command["details"]}};
        if (command.contains("planned")) fields["planned"] = command["planned"];
        own_.advertisement = make("Advertisement", own_.session, ++own_.seq, std::move(fields));
        phase_ = Phase::advertising;
        arm(Timer::advertise, p_.t_advertise());
        broadcast_advertisement();
        return nullptr;
    }

    const char* close() {                                                           // ADV-9
        if (phase_ != Phase::advertising) return "CMD-1: no window is open";
        if (own_.recorded.empty()) return "ADV-9: nobody has answered";
        stop(Timer::advertise);
        on_advertise_end();
        return nullptr;
    }

    const char* prescribe(const json& command) {                                    // PRE-2, NEG-7
        if (!awaits_proposal()) return "CMD-1: not the time to prescribe";
        if (command["proposal"] != own_.proposal + 1) return "PRE-5: another proposal";
        const Id target = command["target"];
        if (own_.recorded.count(target) == 0 && target != own_.peer) return "PRE-2, NEG-7: not this target";
        stop(Timer::decide);
        phase_ = Phase::prescribing;
        own_.peer = target;
        ++own_.proposal;
        post("Prescription", target,
             {{"proposal", own_.proposal}, {"prescribed", command["prescribed"]},
              {"hold_ms", command["hold_ms"]}, {"lease_ms", command["lease_ms"]}});
        arm(Timer::lease, p_.own_lease(command["lease_ms"]));                       // ACT-4
        own_.recorded.erase(target);
        for (const auto& [station, planned] : own_.recorded) {
            post("Cancel", station, {{"reason", "not_selected"}});
        }
        own_.recorded.clear();
        return nullptr;
    }

    const char* proceed() {                                                         // PRE-3
        if (phase_ != Phase::choosing) return "CMD-1: nothing to choose";
        cancel_and_leave("not_needed");
        return nullptr;
    }

    const char* accept(const json& command) {                                       // NEG-2
        if (const char* refusal = refuse_verdict(command)) return refusal;
        stop(Timer::decide);
        post("Acceptance", own_.peer, {{"proposal", own_.proposal}, {"accepted", true},
                                       {"selected", command["selected"]}});
        enter_actuating();
        arm(Timer::lease, own_.lease_ms);                                           // ACT-4
        return nullptr;
    }

    const char* refuse(const json& command) {                                       // NEG-3
        if (const char* refusal = refuse_verdict(command)) return refusal;
        refuse_proposal("unsafe");
        return nullptr;
    }

    const char* refuse_verdict(const json& command) const {
        if (!is_receiver() || phase_ != Phase::negotiating) return "CMD-1: nothing to verify";
        if (command["proposal"] != own_.proposal) return "PRE-5: another proposal";
        return nullptr;
    }

    const char* complete() {                                                        // ACT-3
        if (!is_prescriber() || phase_ != Phase::actuating) return "CMD-1: nothing to complete";
        post("Fin", own_.peer);
        leave();
        return nullptr;
    }
};

}  // namespace automcm
