package main

import (
	"fmt"
	"slices"
)

var yes, no = true, false

// --- Messages ---

// Receive takes a message as it was decoded. planned is what the application
// would drive, nil if an Advertisement does not concern it.
func (s *Station) Receive(object map[string]any, planned any) {
	m, ok := parse(object)
	switch {
	case !ok:
		s.discard()
	case m.Dst != 0 && m.Dst != s.id:
		// MSG-1: for somebody else.
	case m.Type == "CAM":
		s.onCAM(m)
	case s.breaksProtocol(m):
		s.discard()
	default:
		switch m.Type {
		case "Advertisement":
			s.onAdvertisement(m, planned)
		case "Intention":
			s.onIntention(m)
		case "Prescription":
			s.onPrescription(m)
		case "Acceptance":
			s.onAcceptance(m)
		case "Fin":
			s.onFin(m)
		case "Cancel":
			s.onCancel(m)
		case "Ack":
			s.onAck(m)
		}
	}
}

// breaksProtocol says whether a well-formed message is one of those that no
// station that follows the rules would send (END-5).
func (s *Station) breaksProtocol(m *Message) bool {
	if m.Src == s.id {
		return true // a radio echo
	}
	if (m.Type == "Advertisement") == (m.Dst != 0) {
		return true
	}
	prescriber := m.Session.prescriber()
	switch m.Type {
	case "Advertisement":
		return m.Src != prescriber
	case "Prescription":
		newer := s.in(m.Session) && m.Proposal > s.proposal
		return m.Src != prescriber || m.Proposal > s.p.MaxRounds ||
			newer && s.phase != Intending && s.phase != Waiting
	case "Intention":
		return prescriber != s.id
	case "Acceptance":
		// Before the choice there is no target, so peer is 0.
		return prescriber != s.id ||
			s.in(m.Session) && (m.Src != s.peer || m.Proposal > s.proposal)
	case "Cancel":
		return m.Reason == "closed" && m.Src != prescriber
	}
	return false
}

func (s *Station) onAdvertisement(m *Message, planned any) {
	prescriber, number := m.Session[0], m.Session[1]
	known := s.memory[prescriber]
	switch {
	case s.phase != Standalone: // ADV-4
	case planned == nil: // ADV-3: it does not concern the application
	case s.armed(timerQuarantine): // END-8
	case known != nil && number <= known.number: // ADV-8
	case known == nil && len(s.memory) >= s.p.MemoryLimit: // MEM-1
	case !s.room(): // MEM-1
	default: // ADV-3
		s.memory[prescriber] = &joined{number: number, at: s.now}
		s.bind(m.Session, Intending, prescriber)
		s.post(&Message{Type: "Intention", Planned: planned}, prescriber)
	}
}

func (s *Station) onIntention(m *Message) { // ADV-5
	if s.in(m.Session) {
		switch {
		case s.peer == m.Src, s.recorded[m.Src]:
			s.ack(m)
			return
		case s.phase == Advertising && !s.withdrawn[m.Src]:
			if s.roomToRecord() {
				s.recorded[m.Src] = true
				s.ack(m)
			}
			return
		}
	}
	s.answerClosed(m)
}

// roomToRecord says whether one more station can be counted (MEM-1).
func (s *Station) roomToRecord() bool {
	return len(s.recorded)+len(s.withdrawn) < s.p.MaxParticipants
}

// answerClosed answers with the Fin or Cancel that is still being sent there,
// else with Cancel(closed) (ADV-5, NEG-6).
func (s *Station) answerClosed(m *Message) {
	for _, e := range s.outbox {
		last := e.message.Type == "Fin" || e.message.Type == "Cancel"
		if last && e.message.Dst == m.Src && e.message.Session == m.Session {
			s.send(e.message)
			return
		}
	}
	s.answer(m, &Message{Type: "Cancel", Reason: "closed"})
}

func (s *Station) onPrescription(m *Message) {
	switch {
	case s.phase == Standalone: // NEG-5
		s.answer(m, &Message{Type: "Acceptance", Proposal: m.Proposal, Accepted: &no, Reason: "unknown_session"})
	case !s.in(m.Session): // NEG-4
		s.answer(m, &Message{Type: "Acceptance", Proposal: m.Proposal, Accepted: &no, Reason: "busy"})
	case m.Proposal <= s.proposal: // NEG-1: a copy, or an older one
		s.ack(m)
	default: // NEG-1; END-5 left INTENDING and WAITING only
		s.ack(m)
		s.dropType("Intention") // ADV-6
		s.proposal, s.leaseMS = m.Proposal, m.LeaseMS
		s.enter(Negotiating)
		s.arm(timerDecide)
		s.tell(Indication{Name: "verify", Proposal: m.Proposal, Prescribed: m.Prescribed, Rule: "NEG-1"})
	}
}

func (s *Station) onAcceptance(m *Message) { // NEG-6
	if !s.in(m.Session) {
		if *m.Accepted {
			s.answerClosed(m)
		} else {
			s.ack(m)
		}
		return
	}
	s.ack(m)
	awaits := s.phase == Prescribing || s.phase == Negotiating && !s.deciding
	if !awaits || m.Proposal != s.proposal {
		return
	}
	s.dropType("Prescription") // PRE-4
	switch {
	case *m.Accepted:
		left := s.deadlines[timerLease] - s.now
		s.actuate(timerLease)
		s.tell(Indication{Name: "accepted", Proposal: m.Proposal, Selected: m.Selected, LeaseLeft: left, Rule: "NEG-6"})
	case !m.isAnswer() && m.Proposal < s.p.MaxRounds: // NEG-7
		s.enter(Negotiating)
		s.deciding = true
		s.arm(timerDecide)
		s.tell(Indication{Name: "propose", Proposal: m.Proposal + 1, Reason: m.Reason, Rule: "NEG-7"})
	default: // NEG-7
		s.giveUpSession("no_agreement", "NEG-7")
	}
}

// actuate enters ACTUATING. CAMs count anew (ACT-5).
func (s *Station) actuate(keep ...Timer) {
	s.enter(Actuating, keep...)
	s.heard = -1
	s.arm(timerCAM)
}

// giveUpSession cancels, leaves and tells the application why.
func (s *Station) giveUpSession(reason, rule string) {
	s.cancel(reason)
	s.leave()
	s.fallback(reason, rule)
}

func (s *Station) onFin(m *Message) {
	s.ack(m) // END-3
	if s.in(m.Session) && !s.prescribes() && m.Src == s.peer {
		s.leave()
		s.tell(Indication{Name: "finished", Rule: "ACT-3"})
	}
}

func (s *Station) onCancel(m *Message) {
	s.ack(m) // END-3
	switch {
	case !s.in(m.Session):
	case s.peer == m.Src: // END-2
		s.leave()
		s.fallback(m.Reason, "END-2")
	case s.phase == Advertising: // END-2: for good, even before its Intention
		if s.recorded[m.Src] || s.roomToRecord() {
			delete(s.recorded, m.Src)
			s.withdrawn[m.Src] = true
		}
	case s.phase == Choosing && s.recorded[m.Src]: // END-2
		delete(s.recorded, m.Src)
		if len(s.recorded) == 0 {
			s.noParticipants()
		}
	}
}

// noParticipants ends a session that nobody takes part in (PRE-1, END-7).
func (s *Station) noParticipants() {
	s.leave()
	s.arm(timerBackoff)
	s.tell(Indication{Name: "no_participants", Rule: "PRE-1"})
}

func (s *Station) onAck(m *Message) { // END-6
	for _, e := range s.outbox {
		sent := e.message
		if sent.Dst == m.Src && sent.Session == m.Session && sent.Type == m.Of.Type && sent.Seq == m.Of.Seq {
			s.drop(e)
			switch sent.Type {
			case "Intention": // ADV-6
				s.wait()
			case "Prescription": // PRE-4
				s.enter(Negotiating, timerLease)
				s.arm(timerAnswer)
			}
			return // NEG-9, REL-1: the others change no phase
		}
	}
}

// wait enters WAITING (ADV-6, NEG-3).
func (s *Station) wait() {
	s.enter(Waiting)
	s.arm(timerHold)
}

func (s *Station) onCAM(m *Message) { // ACT-5
	if s.phase != Actuating || m.Src != s.peer || !slices.Contains(m.marks, s.session) {
		return
	}
	if s.heard < 0 {
		s.firstCAM, s.firstCAMAt = m.generation, s.now
	}
	elapsed := s.now - s.firstCAMAt
	lead := elapsed + (elapsed*s.p.ClockDrift+99)/100 + 4*s.p.Resend
	if m.generation > s.heard && m.generation <= s.firstCAM+lead {
		s.heard = m.generation
		s.arm(timerCAM)
	}
}

// --- Timers ---

func (s *Station) expire(d due) {
	s.stop(d.timer)
	switch d.timer {
	case timerAdvertise: // PRE-1
		if len(s.recorded) == 0 {
			s.noParticipants()
			return
		}
		s.choose("PRE-1")
	case timerResendAdvertisement: // ADV-2
		s.send(s.advertisement)
		s.arm(timerResendAdvertisement)
	case timerDecide:
		if s.prescribes() { // PRE-5
			s.giveUpSession("abort", "PRE-5")
		} else { // NEG-3
			s.refuseProposal("undecided")
			s.tell(Indication{Name: "undecided", Proposal: s.proposal, Rule: "NEG-3"})
		}
	case timerHold: // ADV-7
		s.leave()
		s.fallback("timeout", "ADV-7")
	case timerAnswer: // NEG-8
		s.giveUpSession("timeout", "NEG-8")
	case timerCAM: // ACT-2
		s.giveUpSession("cam_loss", "ACT-2")
	case timerLease: // ACT-4
		s.giveUpSession("lease_expired", "ACT-4")
	case timerGiveup:
		s.drop(d.entry)
		switch d.entry.message.Type {
		case "Intention": // ADV-6
			s.wait()
		case "Prescription": // PRE-4
			s.giveUpSession("timeout", "PRE-4")
		} // NEG-9, REL-1: the others change no phase
	case timerResend: // REL-1
		s.send(d.entry.message)
		d.entry.resend = s.now + s.lasts(timerResend)
	case timerForget: // ADV-8
		delete(s.memory, d.prescriber)
	case timerQuarantine, timerBackoff: // END-8, ACT-6, END-7: only over
	}
}

// choose closes the window, in which somebody has answered.
func (s *Station) choose(rule string) {
	s.enter(Choosing)
	s.arm(timerDecide)
	s.tell(Indication{Name: "choose", Stations: s.recordedStations(), Rule: rule})
}

// refuseProposal says no and goes back to WAITING (NEG-3).
func (s *Station) refuseProposal(reason string) {
	s.post(&Message{Type: "Acceptance", Proposal: s.proposal, Accepted: &no, Reason: reason}, s.peer)
	s.wait()
}

// --- Commands ---

// Command is what the application wants.
type Command struct {
	Name       string  `json:"name"`
	Session    Session `json:"session"`
	Proposal   int64   `json:"proposal"`
	Target     int64   `json:"target"`
	Scenario   string  `json:"scenario"`
	Details    any     `json:"details"`
	Planned    any     `json:"planned"`
	Prescribed any     `json:"prescribed"`
	Selected   any     `json:"selected"`
	HoldMS     int64   `json:"hold_ms"`
	LeaseMS    int64   `json:"lease_ms"`
}

// Do carries out a command, or refuses it (CMD-1, PRE-5). The error is for a
// command that does not exist.
func (s *Station) Do(c *Command) error {
	own := s.in(c.Session)
	receives := own && !s.prescribes() && s.phase == Negotiating && c.Proposal == s.proposal
	switch c.Name {
	case "request":
		s.request(c)
	case "close": // ADV-9
		switch {
		case !own || s.phase != Advertising:
			s.refuse("CMD-1")
		case len(s.recorded) == 0:
			s.refuse("ADV-9")
		default:
			s.choose("ADV-9")
		}
	case "prescribe":
		s.prescribe(c)
	case "proceed": // PRE-3
		if !own || s.phase != Choosing {
			s.refuse("CMD-1")
			break
		}
		s.cancel("not_needed")
		s.leave()
	case "complete": // ACT-3
		if !own || s.phase != Actuating || !s.prescribes() {
			s.refuse("CMD-1")
			break
		}
		s.post(&Message{Type: "Fin"}, s.peer)
		s.leave()
	case "abort": // END-1
		if !own {
			s.refuse("CMD-1")
			break
		}
		s.cancel("abort")
		s.leave()
	case "accept": // NEG-2
		if !receives {
			s.refuse("CMD-1")
			break
		}
		s.post(&Message{Type: "Acceptance", Proposal: s.proposal, Accepted: &yes, Selected: c.Selected}, s.peer)
		s.actuate()
		s.deadlines[timerLease] = s.now + s.leaseMS
	case "refuse": // NEG-3
		if !receives {
			s.refuse("CMD-1")
			break
		}
		s.refuseProposal("unsafe")
	default:
		return fmt.Errorf("no such command of the application: %q", c.Name)
	}
	return nil
}

func (s *Station) request(c *Command) {
	switch {
	case s.phase != Standalone:
		s.refuse("ADV-1")
	case s.armed(timerQuarantine):
		s.refuse("ACT-6")
	case s.armed(timerBackoff):
		s.refuse("END-7")
	case !s.room():
		s.refuse("MEM-1")
	default:
		s.number++
		s.bind(Session{s.id, s.number}, Advertising, 0)
		s.recorded, s.withdrawn = map[int64]bool{}, map[int64]bool{}
		s.seq = 1
		s.advertisement = &Message{
			V: 1, Type: "Advertisement", Src: s.id, Session: s.session, Seq: s.seq,
			Scenario: &c.Scenario, Details: c.Details, Planned: c.Planned,
		}
		s.send(s.advertisement)
		s.arm(timerAdvertise)
		s.arm(timerResendAdvertisement)
	}
}

// prescribe sends the first proposal to a station of its choice (PRE-2), or
// after a refusal the next one to the same target (NEG-7).
func (s *Station) prescribe(c *Command) {
	first := s.phase == Choosing && s.recorded[c.Target]
	next := s.phase == Negotiating && s.deciding && c.Target == s.peer
	if !s.in(c.Session) || !first && !next || c.Proposal != s.proposal+1 {
		s.refuse("CMD-1")
		return
	}
	s.peer, s.proposal = c.Target, c.Proposal
	s.enter(Prescribing)
	s.post(&Message{
		Type: "Prescription", Proposal: c.Proposal, Prescribed: c.Prescribed,
		HoldMS: &c.HoldMS, LeaseMS: c.LeaseMS,
	}, s.peer)
	s.deadlines[timerLease] = s.now + s.p.ownLease(c.LeaseMS) // ACT-4: from the first sending
	if first {
		delete(s.recorded, s.peer)
		for _, station := range s.recordedStations() {
			s.post(&Message{Type: "Cancel", Reason: "not_selected"}, station)
		}
		s.recorded, s.withdrawn = nil, nil
	}
}
