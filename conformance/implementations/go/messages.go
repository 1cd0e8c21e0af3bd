// The form of a message, written from docs/messages.md alone: it is independent of
// automcm_spec.vocabulary.messages.

package main

import (
	"encoding/json"
	"slices"
	"strconv"
	"unicode/utf8"
)

// Session is the name of a session: its prescriber and a number.
type Session [2]int64

func (s Session) prescriber() int64 { return s[0] }

// MessageID is what an Ack acknowledges.
type MessageID struct {
	Type string `json:"type"`
	Seq  int64  `json:"seq"`
}

// Message is one of the seven messages. Trajectories and details mean nothing
// to the station (section 2), so they stay as they were decoded.
type Message struct {
	V          int        `json:"v"`
	Type       string     `json:"type"`
	Src        int64      `json:"src"`
	Dst        int64      `json:"dst,omitempty"`
	Session    Session    `json:"session"`
	Seq        int64      `json:"seq"`
	Scenario   *string    `json:"scenario,omitempty"`
	Details    any        `json:"details,omitempty"`
	Planned    any        `json:"planned,omitempty"`
	Proposal   int64      `json:"proposal,omitempty"`
	Prescribed any        `json:"prescribed,omitempty"`
	HoldMS     *int64     `json:"hold_ms,omitempty"`
	LeaseMS    int64      `json:"lease_ms,omitempty"`
	Accepted   *bool      `json:"accepted,omitempty"`
	Selected   any        `json:"selected,omitempty"`
	Reason     string     `json:"reason,omitempty"`
	Of         *MessageID `json:"of,omitempty"`

	// Of a CAM that was received.
	generation int64
	marks      []Session
}

// CAM is a position message as this station sends it: it knows no position.
type CAM struct {
	V          int       `json:"v"`
	Type       string    `json:"type"`
	Src        int64     `json:"src"`
	Generation int64     `json:"generation_ms"`
	X          int64     `json:"x_mm"`
	Y          int64     `json:"y_mm"`
	Heading    int64     `json:"heading_mrad"`
	Speed      int64     `json:"speed_mm_s"`
	Marks      []Session `json:"marks"`
}

// Bounds of messages.md.
const (
	maxInteger = 1<<53 - 1
	maxStation = 1<<32 - 1
	maxText    = 65507
	maxNesting = 32
	maxMarks   = 255
)

// A check says whether a decoded JSON value is allowed. Numbers are decoded as
// json.Number, so that 1.0 can be told from 1.
type check func(value any) bool

func integer(from, to int64) check {
	return func(value any) bool {
		n, ok := toInteger(value)
		return ok && from <= n && n <= to
	}
}

func toInteger(value any) (int64, bool) {
	number, ok := value.(json.Number)
	if !ok {
		return 0, false
	}
	n, err := strconv.ParseInt(string(number), 10, 64) // fails for 1.0 and 1e3
	return n, err == nil
}

func oneOf(allowed ...string) check {
	return func(value any) bool {
		text, ok := value.(string)
		return ok && slices.Contains(allowed, text)
	}
}

func isBool(value any) bool {
	_, ok := value.(bool)
	return ok
}

func isText(value any) bool {
	text, ok := value.(string)
	return ok && utf8.RuneCountInString(text) <= maxText
}

var (
	anyInteger = integer(-maxInteger, maxInteger)
	fromZero   = integer(0, maxInteger)
	fromOne    = integer(1, maxInteger)
	isStation  = integer(1, maxStation)
	isExtent   = integer(100, 102_100)
)

func isSession(value any) bool {
	list, ok := value.([]any)
	return ok && len(list) == 2 && isStation(list[0]) && fromOne(list[1])
}

func isMarks(value any) bool {
	list, ok := value.([]any)
	return ok && len(list) <= maxMarks && all(list, isSession)
}

func isPoint(value any) bool {
	list, ok := value.([]any)
	return ok && len(list) == 3 && all(list, anyInteger)
}

func isTrajectory(value any) bool {
	object, ok := value.(map[string]any)
	if !ok || len(object) != 2 || !anyInteger(object["t0"]) {
		return false
	}
	points, ok := object["points"].([]any)
	return ok && len(points) >= 1 && all(points, isPoint)
}

func isMessageID(value any) bool {
	object, ok := value.(map[string]any)
	return ok && len(object) == 2 && isOfType(object["type"]) && fromZero(object["seq"])
}

var isOfType = oneOf("Advertisement", "Intention", "Prescription", "Acceptance", "Fin", "Cancel", "Ack")

func isDetails(value any) bool {
	_, ok := value.(map[string]any)
	return ok && isPlain(value, 1)
}

// isPlain allows texts, integers, booleans, lists and objects; a list or an
// object that is found at this depth must not lie deeper than the limit.
func isPlain(value any, depth int) bool {
	switch v := value.(type) {
	case []any:
		if depth > maxNesting {
			return false
		}
		return all(v, func(item any) bool { return isPlain(item, depth+1) })
	case map[string]any:
		if depth > maxNesting {
			return false
		}
		for name, item := range v {
			if !isText(name) || !isPlain(item, depth+1) {
				return false
			}
		}
		return true
	case bool:
		return true
	}
	return isText(value) || anyInteger(value)
}

func all(list []any, allowed check) bool {
	for _, item := range list {
		if !allowed(item) {
			return false
		}
	}
	return true
}

// A form says which fields a type has. All are required but the optional ones.
type form struct {
	fields   map[string]check
	optional []string
}

// ofSession is the form of one of the seven messages. Which seq goes with which
// reason is looked at in parse; dst is required where END-5 says so.
func ofSession(fields map[string]check, optional ...string) form {
	fields["v"] = integer(1, 1)
	fields["type"] = isText
	fields["src"] = isStation
	fields["dst"] = isStation
	fields["session"] = isSession
	if fields["seq"] == nil {
		fields["seq"] = fromOne
	}
	return form{fields, append(optional, "dst")}
}

var forms = map[string]form{
	"Advertisement": ofSession(map[string]check{
		"scenario": isText, "details": isDetails, "planned": isTrajectory,
	}, "planned"),
	"Intention": ofSession(map[string]check{
		"planned": isTrajectory, "length_mm": isExtent, "width_mm": isExtent,
	}, "length_mm", "width_mm"),
	"Prescription": ofSession(map[string]check{
		"proposal": fromOne, "prescribed": isTrajectory, "hold_ms": fromZero, "lease_ms": fromOne,
	}),
	"Acceptance": ofSession(map[string]check{
		"seq": fromZero, "proposal": fromOne, "accepted": isBool, "selected": isTrajectory,
		"reason": oneOf("unsafe", "undecided", "busy", "unknown_session"),
	}, "selected", "reason"),
	"Fin": ofSession(map[string]check{}),
	"Cancel": ofSession(map[string]check{
		"seq": fromZero,
		"reason": oneOf("not_selected", "not_needed", "no_agreement", "timeout", "cam_loss",
			"lease_expired", "abort", "closed"),
	}),
	"Ack": ofSession(map[string]check{"seq": integer(0, 0), "of": isMessageID}),
	"CAM": {fields: map[string]check{
		"v": integer(1, 1), "type": isText, "src": isStation, "generation_ms": fromZero,
		"x_mm": anyInteger, "y_mm": anyInteger, "heading_mrad": anyInteger,
		"speed_mm_s": anyInteger, "marks": isMarks, "length_mm": isExtent, "width_mm": isExtent,
		"station_type": integer(0, 255), "sigma_mm": fromZero,
	}, optional: []string{"length_mm", "width_mm", "station_type", "sigma_mm"}},
}

// parse gives the message that a decoded object holds, or false if it is
// malformed or of unknown type (END-5).
func parse(object map[string]any) (*Message, bool) {
	kind, _ := object["type"].(string)
	form, known := forms[kind]
	if !known {
		return nil, false
	}
	for name, value := range object {
		allowed := form.fields[name]
		if allowed == nil || !allowed(value) {
			return nil, false
		}
	}
	for name := range form.fields {
		if _, present := object[name]; !present && !slices.Contains(form.optional, name) {
			return nil, false
		}
	}
	m := fill(object)
	return m, m.coherent(object)
}

// fill copies fields whose form has been checked.
func fill(object map[string]any) *Message {
	number := func(name string) int64 {
		n, _ := toInteger(object[name])
		return n
	}
	m := &Message{
		V: 1, Src: number("src"), Dst: number("dst"), Seq: number("seq"),
		Planned: object["planned"], Proposal: number("proposal"),
		Prescribed: object["prescribed"], LeaseMS: number("lease_ms"),
		Selected: object["selected"], generation: number("generation_ms"),
	}
	m.Type = object["type"].(string)
	m.Reason, _ = object["reason"].(string)
	if session, ok := object["session"]; ok {
		m.Session = toSession(session)
	}
	if accepted, ok := object["accepted"].(bool); ok {
		m.Accepted = &accepted
	}
	if of, ok := object["of"].(map[string]any); ok {
		seq, _ := toInteger(of["seq"])
		m.Of = &MessageID{of["type"].(string), seq}
	}
	if marks, ok := object["marks"].([]any); ok {
		for _, mark := range marks {
			m.marks = append(m.marks, toSession(mark))
		}
	}
	return m
}

func toSession(value any) Session {
	list := value.([]any)
	prescriber, _ := toInteger(list[0])
	number, _ := toInteger(list[1])
	return Session{prescriber, number}
}

// coherent says whether the fields fit each other: selected, reason and seq
// (section 2, "Reason and seq belong together").
func (m *Message) coherent(object map[string]any) bool {
	switch m.Type {
	case "Acceptance":
		_, selected := object["selected"]
		_, reason := object["reason"]
		return selected == *m.Accepted && reason != *m.Accepted && m.isAnswer() == (m.Seq == 0)
	case "Cancel":
		return m.isAnswer() == (m.Seq == 0)
	}
	return true
}

// isAnswer says whether the reason is one of those that only answers have.
func (m *Message) isAnswer() bool {
	return m.Reason == "busy" || m.Reason == "unknown_session" || m.Reason == "closed"
}
