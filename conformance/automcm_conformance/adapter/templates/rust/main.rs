//! An adapter for the AutoMCM conformance kit: it translates lines to calls of your station.
//!
//!     automcm conform check-adapter -- ./run      # is each line valid?
//!     automcm conform run -- ./run                # is the station correct?
//!
//! It implements the whole adapter protocol, but the station is empty. Work through the TODOs.
//! json.rs is a minimal parser, so that this builds without a crate; serde_json may replace it.
mod json;

use json::Json;
use std::io::{self, BufRead, Write};

fn about() -> Json {
    let texts = |names: &[&str]| Json::Array(names.iter().map(|name| Json::text(name)).collect());
    Json::object(vec![
        ("protocol", Json::Integer(1)),
        ("name", Json::text("my station")),                      // TODO
        ("version", Json::text("0.1")),                          // TODO
        ("issues", Json::text("where to report a bug in it")),   // TODO
        ("features", texts(&["prescriber", "receiver"])),        // TODO: restart, durations, cam
        ("scenarios", texts(&["lane_change"])),                  // TODO: what a request may name
        ("fixed", Json::object(vec![])),                         // TODO: fixed parameters
    ])
}

/// TODO: replace this with your station.
struct Station {
    messages: Vec<Json>,    // TODO: add each message that is sent
    indications: Vec<Json>, // TODO: add each indication to the application
}

impl Station {
    fn new(_now: i64, _station: i64, _seed: i64, _parameters: &Json) -> Station {
        Station { messages: vec![], indications: vec![] }
    }

    /// TODO: fire each timer due at `now` or earlier, in the order of protocol.md section 3.
    fn advance(&mut self, _now: i64) {}

    /// TODO: handle a message; `planned` is None unless an Advertisement concerns the station.
    fn receive(&mut self, _message: &Json, _planned: Option<&Json>) {}

    /// TODO: handle request, close, prescribe, proceed, complete, abort, accept and refuse.
    fn command(&mut self, _command: &Json) {}

    /// TODO: the time (not the duration) of the earliest armed timer, if any.
    fn deadline(&self) -> Option<i64> {
        None
    }

    /// Everything since the last answer. TODO: add "phase" if the station can report it.
    fn answer(&mut self) -> Json {
        Json::object(vec![
            ("messages", Json::Array(std::mem::take(&mut self.messages))),
            ("indications", Json::Array(std::mem::take(&mut self.indications))),
            ("deadline", self.deadline().map_or(Json::Null, Json::Integer)),
        ])
    }
}

fn answer(line: &Json, station: &mut Option<Station>) -> Result<Json, String> {
    let cmd = line.member("cmd")?.as_text()?;
    if cmd == "hello" {
        return Ok(about());
    }
    if cmd == "reset" {
        let integer = |name| line.member(name)?.as_integer();
        let parameters = line.member("parameters")?;
        let made = Station::new(integer("now")?, integer("station")?, integer("seed")?, parameters);
        return Ok(station.insert(made).answer());
    }
    let station = station.as_mut().ok_or("reset comes first")?;
    if !["receive", "command", "advance"].contains(&cmd) {
        return Err(format!("unknown command {cmd}"));
    }
    station.advance(line.member("now")?.as_integer()?); // timers before any input of the instant
    match cmd {
        "receive" => station.receive(line.member("message")?, line.get("planned")),
        "command" => station.command(line.member("command")?),
        _ => {}
    }
    Ok(station.answer())
}

fn main() -> io::Result<()> {
    let mut station = None;
    for text in io::stdin().lock().lines() {
        let line = Json::parse(&text?);
        if let Ok(Json::Text(cmd)) = line.as_ref().map(|line| line.get("cmd").unwrap_or(&Json::Null)) {
            if cmd == "stop" {
                return Ok(());
            }
        }
        let reply = line.and_then(|line| answer(&line, &mut station));
        let reply = reply.unwrap_or_else(|why| Json::object(vec![("error", Json::text(&why))]));
        let mut output = io::stdout().lock(); // print anything else to stderr
        writeln!(output, "{reply}")?;
        output.flush()?;
    }
    Ok(())
}
