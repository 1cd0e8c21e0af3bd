package main

import (
	"maps"
	"math/rand/v2"
	"slices"
)

// Parameters of section 3 of the protocol, in milliseconds or counts.
type Parameters struct {
	Timeout         int64 `json:"t_timeout"`
	Resend          int64 `json:"t_resend"`
	Decide          int64 `json:"t_decide"`
	CAMLoss         int64 `json:"t_cam_loss"`
	CAM             int64 `json:"t_cam"`
	BackoffMin      int64 `json:"backoff_min"`
	BackoffMax      int64 `json:"backoff_max"`
	MaxRounds       int64 `json:"max_rounds"`
	MaxParticipants int   `json:"max_participants"`
	OutboxLimit     int   `json:"outbox_limit"`
	MemoryLimit     int   `json:"memory_limit"`
	ClockDrift      int64 `json:"clock_drift"` // percent
}

func (p *Parameters) giveup() int64    { return (1 + p.Timeout/p.Resend) * p.Resend }
func (p *Parameters) advertise() int64 { return p.giveup() }
func (p *Parameters) life() int64      { return 2 * p.giveup() }

// ownLease is how long a prescriber's lease lasts: its clock may be slower than its target's (ACT-4).
func (p *Parameters) ownLease(leaseMS int64) int64 {
	if p.ClockDrift == 0 {
		return leaseMS
	}
	return max(1, leaseMS-(leaseMS*p.ClockDrift+99)/100-1)
}

// Phase is one of section 4.
type Phase string

const (
	Standalone  Phase = "STANDALONE"
	Advertising Phase = "ADVERTISING"
	Choosing    Phase = "CHOOSING"
	Prescribing Phase = "PRESCRIBING"
	Intending   Phase = "INTENDING"
	Waiting     Phase = "WAITING"
	Negotiating Phase = "NEGOTIATING"
	Actuating   Phase = "ACTUATING"
)

// Timer is one of section 3, in the order in which those of one instant fire.
type Timer int

const (
	timerAdvertise Timer = iota
	timerResendAdvertisement
	timerDecide
	timerHold
	timerAnswer
	timerCAM
	timerLease
	timerGiveup // one for each entry of the outbox
	timerResend // the same
	timerQuarantine
	timerForget // one for each prescriber that is remembered
	timerBackoff
	timers
)

// timerNames are those of the command durations. The lease has none.
var timerNames = [timers]string{
	"advertise", "resend", "decide", "hold", "answer", "cam", "", "giveup", "resend",
	"quarantine", "forget", "backoff",
}

// entry is a reliable message that is still being sent, with its two deadlines.
type entry struct {
	message        *Message
	giveup, resend int64
}

// joined is what ADV-8 remembers of a prescriber.
type joined struct {
	number   int64 // the highest session joined
	at       int64 // when
	deadline int64 // of forget; 0 while the station is in that session
}

// Indication is what the application is told.
type Indication struct {
	Name       string   `json:"name"`
	Session    *Session `json:"session,omitempty"`
	Stations   []int64  `json:"stations,omitempty"`
	Proposal   int64    `json:"proposal,omitempty"`
	Prescribed any      `json:"prescribed,omitempty"`
	Selected   any      `json:"selected,omitempty"`
	LeaseLeft  int64    `json:"lease_left_ms,omitempty"`
	Reason     string   `json:"reason,omitempty"`
	Rule       string   `json:"rule"`
}

// Output is what one input brought about.
type Output struct {
	Messages    []*Message
	Indications []Indication
	CAMs        []CAM
}

// Station is the protocol core. Inputs are the exported methods; time comes in
// with AdvanceTo, and Take gives what came out.
type Station struct {
	id        int64
	p         Parameters
	random    *rand.Rand
	durations map[string]int64 // told by the command durations

	now       int64
	nextCAM   int64
	deadlines [timers]int64 // 0: not armed
	outbox    []*entry      // oldest first
	memory    map[int64]*joined
	number    int64 // of the last own session
	out       Output

	// The session it is bound to; all of it is void in STANDALONE.
	phase    Phase
	session  Session
	peer     int64 // 0 in ADVERTISING and CHOOSING
	seq      int64 // the last one used
	proposal int64 // prescriber: the last sent; receiver: the newest seen; 0: none

	advertisement *Message
	recorded      map[int64]bool
	withdrawn     map[int64]bool
	deciding      bool  // prescriber: NEGOTIATING, but the application's turn
	leaseMS       int64 // receiver: of the Prescription it verifies
	heard         int64 // generation time of the last CAM that counted, or -1
	firstCAM      int64 // that of the first one
	firstCAMAt    int64 // when it was received
}

// NewStation gives a station that has never had a session.
func NewStation(id, now int64, seed uint64, p Parameters) *Station {
	return &Station{
		id: id, p: p, now: now, nextCAM: now + p.CAM, phase: Standalone,
		random:    rand.New(rand.NewPCG(seed, uint64(id))),
		durations: map[string]int64{}, memory: map[int64]*joined{},
	}
}

// Take gives what has come out since the last call.
func (s *Station) Take() Output {
	out := s.out
	s.out = Output{}
	return out
}

// Deadline gives the time of the earliest timer, or false if none is armed.
func (s *Station) Deadline() (int64, bool) {
	next, ok := s.next()
	return next.at, ok
}

// --- Time ---

// due is a timer that is armed.
type due struct {
	at         int64
	timer      Timer
	entry      *entry // of giveup and resend
	prescriber int64  // of forget
}

// next finds the timer that expires first (section 3: by deadline, then in the
// order of the table, then the older message).
func (s *Station) next() (first due, found bool) {
	consider := func(d due) {
		if d.at != 0 && (!found || d.at < first.at || d.at == first.at && d.timer < first.timer) {
			first, found = d, true
		}
	}
	for t, at := range s.deadlines {
		consider(due{at: at, timer: Timer(t)})
	}
	for _, e := range s.outbox {
		consider(due{at: e.giveup, timer: timerGiveup, entry: e})
		consider(due{at: e.resend, timer: timerResend, entry: e})
	}
	for p, j := range s.memory {
		consider(due{at: j.deadline, timer: timerForget, prescriber: p})
	}
	return first, found
}

// AdvanceTo moves the time and fires what is due; what a late timer arms lasts from now.
func (s *Station) AdvanceTo(now int64) {
	s.now = now
	for {
		next, ok := s.next()
		if !ok || next.at > now {
			break
		}
		s.sendCAMs(next.at)
		s.expire(next)
	}
	s.sendCAMs(now)
}

// sendCAMs sends what has fallen due up to now, in every phase (ACT-2).
func (s *Station) sendCAMs(now int64) {
	for ; s.nextCAM <= now; s.nextCAM += s.p.CAM {
		s.out.CAMs = append(s.out.CAMs,
			CAM{V: 1, Type: "CAM", Src: s.id, Generation: s.nextCAM, Marks: s.marks()})
	}
}

// marks are the session it is bound to and those whose Fin is still being sent
// (ACT-5).
func (s *Station) marks() []Session {
	marks := []Session{}
	if s.phase != Standalone {
		marks = append(marks, s.session)
	}
	for _, e := range s.outbox {
		if e.message.Type == "Fin" {
			marks = append(marks, e.message.Session)
		}
	}
	return marks
}

// lasts gives how long a timer lasts if it is armed now (section 3).
func (s *Station) lasts(t Timer) int64 {
	if told, ok := s.durations[timerNames[t]]; ok {
		return told
	}
	p := &s.p
	switch t {
	case timerAdvertise:
		return p.advertise()
	case timerResendAdvertisement, timerResend:
		return p.Resend
	case timerDecide:
		return p.Decide
	case timerHold: // ADV-7
		return p.advertise() + p.Decide + 2*p.giveup()
	case timerAnswer:
		return p.Decide + p.giveup()
	case timerCAM:
		return p.CAMLoss
	case timerGiveup:
		return p.giveup()
	case timerQuarantine: // END-8, ACT-6
		return max(p.advertise()+p.life(), p.CAMLoss+p.Resend/2)
	case timerBackoff: // END-7
		return p.BackoffMin + s.random.Int64N(p.BackoffMax-p.BackoffMin+1)
	}
	panic("this timer has no duration of its own")
}

func (s *Station) arm(t Timer)        { s.deadlines[t] = s.now + s.lasts(t) }
func (s *Station) stop(t Timer)       { s.deadlines[t] = 0 }
func (s *Station) armed(t Timer) bool { return s.deadlines[t] != 0 }

// --- Phases ---

// enter changes the phase and stops its timers, apart from those to keep.
func (s *Station) enter(p Phase, keep ...Timer) {
	s.phase = p
	s.deciding = false
	for t := timerAdvertise; t <= timerLease; t++ {
		if !slices.Contains(keep, t) {
			s.stop(t)
		}
	}
}

// bind begins a session.
func (s *Station) bind(session Session, p Phase, peer int64) {
	s.session, s.peer = session, peer
	s.seq, s.proposal = 0, 0
	s.enter(p)
}

// leave goes to STANDALONE and out of the session. It ends the Advertisement
// and all sending but that of Fin and Cancel (END-1).
func (s *Station) leave() {
	if j := s.memory[s.session.prescriber()]; j != nil && !s.prescribes() {
		j.deadline = s.forgetAt(j) // ADV-8
	}
	s.enter(Standalone)
	s.outbox = slices.DeleteFunc(s.outbox, func(e *entry) bool {
		return e.message.Type != "Fin" && e.message.Type != "Cancel"
	})
	s.advertisement, s.recorded, s.withdrawn, s.peer = nil, nil, nil, 0
}

func (s *Station) forgetAt(j *joined) int64 {
	if told, ok := s.durations[timerNames[timerForget]]; ok {
		return s.now + told
	}
	return max(j.at+s.p.advertise()+s.p.life(), s.now+s.p.life())
}

func (s *Station) prescribes() bool { return s.session.prescriber() == s.id }

// in says whether the station is bound to this session (END-4).
func (s *Station) in(session Session) bool {
	return s.phase != Standalone && s.session == session
}

// Restart is power lost and back (END-8): numbers and what durations has told
// stay, all else is gone.
func (s *Station) Restart(now int64) {
	s.sendCAMs(now)
	s.now = now
	s.phase = Standalone
	s.outbox, s.recorded, s.withdrawn, s.advertisement = nil, nil, nil, nil
	s.deciding, s.peer = false, 0
	s.memory = map[int64]*joined{}
	s.deadlines = [timers]int64{}
	s.arm(timerQuarantine)
}

// --- Sending and telling ---

func (s *Station) send(m *Message) { s.out.Messages = append(s.out.Messages, m) }

// post sends a reliable message of the own session for the first time (REL-1).
// It must not be changed from now on: a copy repeats every byte.
func (s *Station) post(m *Message, to int64) {
	s.seq++
	m.V, m.Src, m.Dst, m.Session, m.Seq = 1, s.id, to, s.session, s.seq
	s.outbox = append(s.outbox,
		&entry{m, s.now + s.lasts(timerGiveup), s.now + s.lasts(timerResend)})
	s.send(m)
}

// answer sends a message that is not sent again and has seq 0.
func (s *Station) answer(to *Message, m *Message) {
	m.V, m.Src, m.Dst, m.Session = 1, s.id, to.Src, to.Session
	s.send(m)
}

// ack acknowledges a copy, but never an answer (END-3, NEG-6).
func (s *Station) ack(m *Message) {
	if m.Seq != 0 {
		s.answer(m, &Message{Type: "Ack", Of: &MessageID{m.Type, m.Seq}})
	}
}

// cancel posts a Cancel to the peer, or in ADVERTISING and CHOOSING to every
// recorded station (END-1).
func (s *Station) cancel(reason string) {
	if s.phase == Actuating && !s.prescribes() {
		s.arm(timerQuarantine) // ACT-6: it breaks its commitment off
	}
	if s.peer != 0 {
		s.post(&Message{Type: "Cancel", Reason: reason}, s.peer)
		return
	}
	for _, station := range s.recordedStations() {
		s.post(&Message{Type: "Cancel", Reason: reason}, station)
	}
}

func (s *Station) recordedStations() []int64 {
	return slices.Sorted(maps.Keys(s.recorded))
}

// drop takes an entry out of the outbox, and with it its timers.
func (s *Station) drop(e *entry) {
	s.outbox = slices.DeleteFunc(s.outbox, func(other *entry) bool { return other == e })
}

// dropType takes all messages of a type out of the outbox.
func (s *Station) dropType(kind string) {
	s.outbox = slices.DeleteFunc(s.outbox, func(e *entry) bool { return e.message.Type == kind })
}

// room says whether the outbox has room for one more session (MEM-1).
func (s *Station) room() bool {
	need := 1 + max(s.p.MaxParticipants, int(s.p.MaxRounds))
	return len(s.outbox)+need <= s.p.OutboxLimit
}

func (s *Station) tell(i Indication) {
	session := s.session
	i.Session = &session
	s.out.Indications = append(s.out.Indications, i)
}

func (s *Station) fallback(reason, rule string) {
	s.tell(Indication{Name: "fallback", Reason: reason, Rule: rule})
}

// discard reports a message that breaks the protocol (END-5).
func (s *Station) discard() {
	s.out.Indications = append(s.out.Indications, Indication{Name: "discarded", Rule: "END-5"})
}

// refuse reports a command that changed nothing.
func (s *Station) refuse(rule string) {
	s.out.Indications = append(s.out.Indications, Indication{Name: "refused", Rule: rule})
}
