// An adapter for the AutoMCM conformance kit: it translates lines to calls of your station.
//
//	automcm conform check-adapter -- ./run      # is each line valid?
//	automcm conform run -- ./run                # is the station correct?
//
// It implements the whole adapter protocol, but the station is empty. Work through the TODOs.
package main

import (
	"bufio"
	"encoding/json"
	"errors"
	"fmt"
	"io"
	"os"
)

// Object is a JSON object. Its integers should be decoded into int64, not float64: then
// encoding/json rejects 1.0, which is malformed (END-5).
type Object map[string]json.RawMessage

var about = map[string]any{
	"protocol":  1,
	"name":      "my station",                       // TODO
	"version":   "0.1",                              // TODO
	"issues":    "where to report a bug in it",      // TODO
	"features":  []string{"prescriber", "receiver"}, // TODO: restart, durations, cam
	"scenarios": []string{"lane_change"},            // TODO: scenarios that a request may name
	"fixed":     map[string]int64{},                 // TODO: parameters that cannot be changed
}

// Line is a line from the kit.
type Line struct {
	Cmd        string           `json:"cmd"`
	Now        int64            `json:"now"`
	Station    uint32           `json:"station"`
	Seed       uint64           `json:"seed"`
	Parameters map[string]int64 `json:"parameters"`
	Message    Object           `json:"message"`
	Planned    json.RawMessage  `json:"planned"`
	Command    Object           `json:"command"`
}

// Station does nothing yet. TODO: replace it with your station.
type Station struct {
	messages    []any // TODO: add each message that is sent
	indications []any // TODO: add each indication to the application
}

// NewStation returns a station that has never had a session.
func NewStation(now int64, station uint32, seed uint64, parameters map[string]int64) *Station {
	return &Station{messages: []any{}, indications: []any{}}
}

// Advance fires each timer whose deadline is now or earlier, in the order of protocol.md section 3.
func (s *Station) Advance(now int64) {} // TODO

// Receive handles a message; planned is nil unless an Advertisement concerns the station.
func (s *Station) Receive(message Object, planned json.RawMessage) {} // TODO

// Command handles request, close, prescribe, proceed, complete, abort, accept and refuse.
func (s *Station) Command(command Object) {} // TODO

// Deadline is the time (not the duration) of the earliest armed timer, or nil.
func (s *Station) Deadline() *int64 { return nil } // TODO

// Answer is everything since the last answer. TODO: add "phase" if the station can report it.
func (s *Station) Answer() any {
	messages, indications := s.messages, s.indications
	s.messages, s.indications = []any{}, []any{}
	return map[string]any{"messages": messages, "indications": indications, "deadline": s.Deadline()}
}

func answer(line Line, station **Station) (any, error) {
	switch line.Cmd {
	case "hello":
		return about, nil
	case "reset":
		*station = NewStation(line.Now, line.Station, line.Seed, line.Parameters)
		return (*station).Answer(), nil
	case "receive", "command", "advance":
	default:
		return nil, fmt.Errorf("unknown command %q", line.Cmd)
	}
	if *station == nil {
		return nil, errors.New("reset comes first")
	}
	(*station).Advance(line.Now) // timers come before any other input of the same instant
	if line.Cmd == "receive" {
		(*station).Receive(line.Message, line.Planned)
	}
	if line.Cmd == "command" {
		(*station).Command(line.Command)
	}
	return (*station).Answer(), nil
}

func main() {
	input := bufio.NewReader(os.Stdin)
	output := json.NewEncoder(os.Stdout) // print anything else to os.Stderr
	var station *Station
	for {
		text, err := input.ReadBytes('\n')
		if err == io.EOF {
			return
		}
		var line Line
		var reply any
		if err = json.Unmarshal(text, &line); err == nil {
			if line.Cmd == "stop" {
				return
			}
			reply, err = answer(line, &station)
		}
		if err != nil {
			reply = map[string]string{"error": err.Error()}
		}
		output.Encode(reply)
	}
}
