// Command station speaks the adapter protocol, version 1, on standard input and
// output: each line is a command, and each but stop has one answer.
package main

import (
	"bufio"
	"bytes"
	"encoding/json"
	"errors"
	"fmt"
	"io"
	"os"
	"slices"
)

// line is a command of the kit. A field is absent where it does not apply.
type line struct {
	Cmd        string           `json:"cmd"`
	Protocol   int64            `json:"protocol"`
	Now        *int64           `json:"now"`
	Station    int64            `json:"station"`
	Seed       uint64           `json:"seed"`
	Parameters *Parameters      `json:"parameters"`
	Message    map[string]any   `json:"message"`
	Planned    any              `json:"planned"`
	Command    *Command         `json:"command"`
	Durations  map[string]int64 `json:"durations"`
}

type helloAnswer struct {
	Protocol  int64            `json:"protocol"`
	Name      string           `json:"name"`
	Version   string           `json:"version"`
	Issues    string           `json:"issues"`
	Features  []string         `json:"features"`
	Scenarios []string         `json:"scenarios"`
	Fixed     map[string]int64 `json:"fixed"`
}

type answer struct {
	Messages    []*Message   `json:"messages"`
	Indications []Indication `json:"indications"`
	Deadline    *int64       `json:"deadline"`
	Phase       Phase        `json:"phase"`
	CAMs        []CAM        `json:"cams,omitempty"`
}

type errorAnswer struct {
	Error string `json:"error"`
}

var hello = helloAnswer{
	Protocol: 1, Name: "station in Go", Version: "1.0.0", Issues: "see the README",
	Features:  []string{"prescriber", "receiver", "restart", "durations", "cam", "clock_drift"},
	Scenarios: []string{"lane_change"},
	Fixed:     map[string]int64{},
}

var errStop = errors.New("stop")

// adapter holds the one station that the lines are about.
type adapter struct {
	station *Station
}

// handle answers one line. errStop means that there is nothing to answer.
func (a *adapter) handle(text []byte) (any, error) {
	var l line
	decoder := json.NewDecoder(bytes.NewReader(text))
	decoder.UseNumber() // so that 1.0 can be told from 1 (END-5)
	if err := decoder.Decode(&l); err != nil {
		return nil, err
	}
	if _, err := decoder.Token(); err != io.EOF {
		return nil, errors.New("more than one object on the line")
	}
	switch l.Cmd {
	case "stop":
		return nil, errStop
	case "hello":
		if l.Protocol != hello.Protocol {
			return nil, fmt.Errorf("protocol %d is not known", l.Protocol)
		}
		return hello, nil
	case "reset":
		if l.Now == nil || l.Parameters == nil {
			return nil, errors.New("reset lacks now or parameters")
		}
		if p := l.Parameters; p.Resend < 1 || p.CAM < 1 || p.BackoffMax < p.BackoffMin ||
			p.ClockDrift < 0 || p.ClockDrift > 99 {
			return nil, errors.New("parameters that no station can keep")
		}
		a.station = NewStation(l.Station, *l.Now, l.Seed, *l.Parameters)
		return a.answer(), nil
	}
	if a.station == nil {
		return nil, errors.New("no reset yet")
	}
	if err := a.input(&l); err != nil {
		return nil, err
	}
	return a.answer(), nil
}

// input gives the station what a line says.
func (a *adapter) input(l *line) error {
	s := a.station
	if l.Cmd == "durations" { // no time passes
		for name, lasts := range l.Durations {
			if name == "" || !slices.Contains(timerNames[:], name) || lasts < 1 {
				return fmt.Errorf("no such duration: %q %d", name, lasts)
			}
		}
		for name, lasts := range l.Durations {
			s.durations[name] = lasts
		}
		return nil
	}
	if l.Now == nil || *l.Now < s.now {
		return errors.New("now is missing or lies before the last one")
	}
	switch l.Cmd {
	case "advance":
		s.AdvanceTo(*l.Now)
	case "receive":
		if l.Message == nil {
			return errors.New("message is missing")
		}
		s.AdvanceTo(*l.Now)
		s.Receive(l.Message, l.Planned)
	case "command":
		if l.Command == nil {
			return errors.New("command is missing")
		}
		s.AdvanceTo(*l.Now)
		return s.Do(l.Command)
	case "restart":
		s.Restart(*l.Now)
	default:
		return fmt.Errorf("no such command: %q", l.Cmd)
	}
	return nil
}

// answer takes what the station has to say.
func (a *adapter) answer() answer {
	out := a.station.Take()
	result := answer{
		Messages: out.Messages, Indications: out.Indications,
		Phase: a.station.phase, CAMs: out.CAMs,
	}
	if result.Messages == nil {
		result.Messages = []*Message{}
	}
	if result.Indications == nil {
		result.Indications = []Indication{}
	}
	if deadline, ok := a.station.Deadline(); ok {
		result.Deadline = &deadline
	}
	return result
}

// serve reads lines until stop or the end of the input. Answers are flushed
// before it would have to wait for the next line.
func serve(input io.Reader, output io.Writer) error {
	reader := bufio.NewReaderSize(input, 1<<16)
	writer := bufio.NewWriterSize(output, 1<<16)
	encoder := json.NewEncoder(writer) // ends each answer with a line feed
	encoder.SetEscapeHTML(false)
	var a adapter
	for {
		if waiting, _ := reader.Peek(reader.Buffered()); bytes.IndexByte(waiting, '\n') < 0 {
			if err := writer.Flush(); err != nil {
				return err
			}
		}
		text, err := reader.ReadBytes('\n')
		if err == io.EOF && len(bytes.TrimSpace(text)) == 0 {
			return writer.Flush()
		} else if err != nil && err != io.EOF {
			return err
		}
		result, err := a.handle(text)
		if err == errStop {
			return writer.Flush()
		} else if err != nil {
			result = errorAnswer{err.Error()}
		}
		if err := encoder.Encode(result); err != nil {
			return err
		}
	}
}

func main() {
	if err := serve(os.Stdin, os.Stdout); err != nil {
		fmt.Fprintln(os.Stderr, "station:", err)
		os.Exit(1)
	}
}
