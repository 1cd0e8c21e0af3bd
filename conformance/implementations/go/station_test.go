package main

import (
	"bufio"
	"encoding/json"
	"io"
	"os"
	"reflect"
	"strings"
	"testing"
)

const me, peer, other = 10, 20, 30

var defaults = Parameters{
	Timeout: 300, Resend: 100, Decide: 500, CAMLoss: 1500, CAM: 100,
	BackoffMin: 500, BackoffMax: 2000, MaxRounds: 3,
	MaxParticipants: 32, OutboxLimit: 64, MemoryLimit: 64,
}

func fresh() *Station { return NewStation(me, 1000, 1, defaults) }

func object(t *testing.T, text string) map[string]any {
	t.Helper()
	decoder := json.NewDecoder(strings.NewReader(text))
	decoder.UseNumber()
	var result map[string]any
	if err := decoder.Decode(&result); err != nil {
		t.Fatal(err)
	}
	return result
}

// got tells what has come out since the last call, in short.
func got(s *Station) string {
	var words []string
	out := s.Take()
	for _, m := range out.Messages {
		word := m.Type
		if m.Reason != "" {
			word += "(" + m.Reason + ")"
		}
		words = append(words, word)
	}
	for _, i := range out.Indications {
		word := i.Name
		if i.Reason != "" {
			word += "(" + i.Reason + ")"
		}
		words = append(words, word)
	}
	return strings.Join(append(words, string(s.phase)), " ")
}

// step does something and compares what comes out.
func step(t *testing.T, s *Station, do func(), want string) {
	t.Helper()
	do()
	if came := got(s); came != want {
		t.Fatalf("came %q, want %q", came, want)
	}
}

// receive is a message from src to this station.
func receive(t *testing.T, s *Station, src, fields string) func() {
	text := `{"v":1,"src":` + src + `,"dst":10,` + fields + `}`
	return func() { s.Receive(object(t, text), nil) }
}

// until passes the time of s, so that each timer fires at its deadline.
func until(s *Station, to int64) func() {
	return func() {
		for s.now < to {
			s.AdvanceTo(s.now + 1)
		}
	}
}

func command(s *Station, c Command) func() { return func() { _ = s.Do(&c) } }

const intention = `"type":"Intention","session":[10,1],"seq":1,"planned":{"t0":0,"points":[[0,0,0]]}`

// acceptance is one of proposal 1 that accepts.
const acceptance = `"type":"Acceptance","session":[10,1],"seq":2,"proposal":1,"accepted":true,"selected":{"t0":0,"points":[[0,0,0]]}`

// chosen brings a station to PRESCRIBING with peer as its target, and with
// other as one that was not selected.
func chosen(t *testing.T) *Station {
	t.Helper()
	s := fresh()
	step(t, s, command(s, Command{Name: "request"}), "Advertisement ADVERTISING")
	step(t, s, receive(t, s, "20", intention), "Ack ADVERTISING")
	step(t, s, receive(t, s, "30", intention), "Ack ADVERTISING")
	step(t, s, until(s, 1400), "Advertisement Advertisement Advertisement choose CHOOSING")
	step(t, s, command(s, Command{Name: "prescribe", Session: Session{me, 1}, Proposal: 1, Target: peer, LeaseMS: 9000}),
		"Prescription Cancel(not_selected) PRESCRIBING")
	return s
}

func TestExchangeOfTheDocuments(t *testing.T) {
	file, err := os.Open("testdata/exchange.txt")
	if err != nil {
		t.Fatal(err)
	}
	defer file.Close()
	var a adapter
	var result any
	lines := bufio.NewScanner(file)
	for lines.Scan() {
		kind, text := lines.Text()[:2], lines.Text()[2:]
		if kind == "> " {
			if result, err = a.handle([]byte(text)); err != nil && err != errStop {
				t.Fatal(err)
			}
			continue
		}
		if _, ok := result.(helloAnswer); ok {
			continue // another implementation
		}
		came, err := json.Marshal(result)
		if err != nil {
			t.Fatal(err)
		}
		if !reflect.DeepEqual(object(t, string(came)), object(t, text)) {
			t.Errorf("came %s\nwant %s", came, text)
		}
	}
}

func TestPrescriberUntilTheFinIsAcked(t *testing.T) {
	s := chosen(t)
	step(t, s, receive(t, s, "20", `"type":"Ack","session":[10,1],"seq":0,"of":{"type":"Prescription","seq":2}`), "NEGOTIATING")
	step(t, s, receive(t, s, "20", acceptance), "Ack accepted ACTUATING")
	step(t, s, command(s, Command{Name: "complete", Session: Session{me, 1}}), "Fin STANDALONE")
	if marks := s.marks(); len(marks) != 1 || marks[0] != (Session{me, 1}) {
		t.Errorf("ACT-5: marks are %v", marks)
	}
	// A late copy is answered with the Fin, not with Cancel(closed) (NEG-6).
	step(t, s, receive(t, s, "20", acceptance), "Fin STANDALONE")
	step(t, s, receive(t, s, "20", `"type":"Ack","session":[10,1],"seq":0,"of":{"type":"Fin","seq":4}`), "STANDALONE")
	step(t, s, receive(t, s, "20", acceptance), "Cancel(closed) STANDALONE")
	if marks := s.marks(); len(marks) != 0 {
		t.Errorf("ACT-5: marks are %v", marks)
	}
}

func TestGivenUpAfterSoManySendings(t *testing.T) { // section 3, PRE-4
	s := chosen(t)
	step(t, s, until(s, 1799),
		strings.Repeat("Prescription Cancel(not_selected) ", 3)+"PRESCRIBING")
	step(t, s, until(s, 1800), "Cancel(timeout) fallback(timeout) STANDALONE")
}

func TestRefusedThenProposedAgain(t *testing.T) { // NEG-7
	s := chosen(t)
	step(t, s, receive(t, s, "20", `"type":"Acceptance","session":[10,1],"seq":2,"proposal":1,"accepted":false,"reason":"unsafe"`),
		"Ack propose(unsafe) NEGOTIATING")
	again := Command{Name: "prescribe", Session: Session{me, 1}, Proposal: 2, Target: other, LeaseMS: 9000}
	step(t, s, command(s, again), "refused NEGOTIATING")
	again.Target = peer
	step(t, s, command(s, again), "Prescription PRESCRIBING")
	step(t, s, receive(t, s, "20", acceptance), "Ack PRESCRIBING") // of proposal 1
	step(t, s, receive(t, s, "20", `"type":"Acceptance","session":[10,1],"seq":0,"proposal":2,"accepted":false,"reason":"busy"`),
		"Cancel(no_agreement) fallback(no_agreement) STANDALONE")
}

func TestNotJoinedAfterARestart(t *testing.T) { // END-8
	s := chosen(t)
	s.Restart(1400)
	advertisement := object(t, `{"v":1,"type":"Advertisement","src":20,"session":[20,5],"seq":1,"scenario":"","details":{}}`)
	hear := func() { s.Receive(advertisement, object(t, `{"t0":0,"points":[[0,0,0]]}`)) }
	step(t, s, hear, "STANDALONE")
	step(t, s, command(s, Command{Name: "request"}), "refused STANDALONE") // ACT-6
	s.AdvanceTo(1400 + 1500 + 50)
	step(t, s, hear, "Intention INTENDING")
	step(t, s, command(s, Command{Name: "abort", Session: Session{20, 5}}), "Cancel(abort) STANDALONE")
	step(t, s, hear, "STANDALONE") // ADV-8: not twice
	s.Do(&Command{Name: "request"})
	if s.session != (Session{me, 2}) {
		t.Errorf("numbers must grow, but the session is %v", s.session)
	}
}

func TestForms(t *testing.T) {
	deep := func(levels int) string {
		return `{"v":1,"type":"Advertisement","src":20,"session":[20,1],"seq":1,"scenario":"","details":` +
			strings.Repeat(`{"a":`, levels-1) + `{}` + strings.Repeat("}", levels)
	}
	head := `{"v":1,"src":20,"dst":10,"session":[20,1],`
	for text, want := range map[string]bool{
		deep(32):                                                   true,
		deep(33):                                                   false,
		head + `"type":"Fin","seq":1}`:                             true,
		head + `"type":"Fin","seq":0}`:                             false,
		head + `"type":"Fin","seq":1.0}`:                           false,
		head + `"type":"Fin","seq":1,"reason":null}`:               false,
		head + `"type":"Fin"}`:                                     false,
		head + `"type":"fin","seq":1}`:                             false,
		head + `"type":"Cancel","seq":0,"reason":"closed"}`:        true,
		head + `"type":"Cancel","seq":1,"reason":"closed"}`:        false,
		head + `"type":"Ack","seq":0,"of":{"type":"Ack","seq":0}}`: true,
		head + `"type":"Ack","seq":0,"of":{"type":"CAM","seq":0}}`: false,
		head + `"type":"Acceptance","seq":0,"proposal":1,"accepted":false,"reason":"busy"}`:                    true,
		head + `"type":"Acceptance","seq":1,"proposal":1,"accepted":false}`:                                    false,
		head + `"type":"Acceptance","seq":1,"proposal":1,"accepted":true}`:                                     false,
		head + `"type":"Intention","seq":1,"planned":{"t0":-5,"points":[[0,0,0],[-1,0,0]]}}`:                   true,
		head + `"type":"Intention","seq":1,"planned":{"t0":0,"points":[]}}`:                                    false,
		head + `"type":"Intention","seq":9007199254740992,"planned":{"t0":0,"points":[[0,0,0]]}}`:              false,
		head + `"type":"Intention","seq":1,"planned":{"t0":0,"points":[[0,0]]}}`:                               false,
		head + `"type":"Intention","seq":1,"planned":{"t0":0,"points":[[0,0,0]],"more":1}}`:                    false,
		`{"v":2,"src":20,"dst":10,"session":[20,1],"type":"Fin","seq":1}`:                                      false,
		`{"v":1,"src":4294967296,"dst":10,"session":[20,1],"type":"Fin","seq":1}`:                              false,
		`{"v":true,"src":20,"dst":10,"session":[20,1],"type":"Fin","seq":1}`:                                   false,
		`{"v":1,"src":20,"dst":10,"session":[20],"type":"Fin","seq":1}`:                                        false,
		`{"v":1,"src":20,"dst":10,"session":[20,1],"type":"Fin","seq":1,"SRC":20}`:                             false,
		`{"v":1,"src":20,"dst":10,"session":[20,1],"type":"Prescription","seq":1,"proposal":1,"hold_ms":0}`:    false,
		`{"v":1,"src":20,"dst":10,"session":[20,1],"type":"Advertisement","seq":1,"scenario":"","details":[]}`: false,
	} {
		if _, ok := parse(object(t, text)); ok != want {
			t.Errorf("well formed is %v: %s", ok, text)
		}
	}
}

func TestLinesOfTheAdapter(t *testing.T) {
	commandIn, commandOut := io.Pipe()
	answerIn, answerOut := io.Pipe()
	ended := make(chan error)
	go func() { ended <- serve(commandIn, answerOut) }()
	answers := bufio.NewReader(answerIn)
	// Two lines and a half at once: two answers must come.
	for _, text := range []string{"{\"cmd\":\"hello\",\"protocol\":1}\nrubbish\n{\"cmd\":", "\"advance\",\"now\":1}\n"} {
		if _, err := io.WriteString(commandOut, text); err != nil {
			t.Fatal(err)
		}
		for range strings.Count(text, "\n") {
			if _, err := answers.ReadString('\n'); err != nil {
				t.Fatal(err)
			}
		}
	}
	commandOut.Close()
	if err := <-ended; err != nil {
		t.Errorf("the end of the input is no error: %v", err)
	}
}
