// An adapter for the AutoMCM conformance kit: it translates lines to calls of your station.
//
//     automcm conform check-adapter -- ./run      # is each line valid?
//     automcm conform run -- ./run                # is the station correct?
//
// It implements the whole adapter protocol, but the station is empty. Work through the TODOs.
"use strict";

const readline = require("node:readline");

const ABOUT = {
  protocol: 1,
  name: "my station", // TODO
  version: "0.1", // TODO
  issues: "where to report a bug in it", // TODO
  features: ["prescriber", "receiver"], // TODO: restart, durations, cam
  scenarios: ["lane_change"], // TODO: scenarios that a request may name
  fixed: {}, // TODO: parameters that cannot be changed, such as {t_resend: 100}
};

// JSON.parse cannot tell 1.0 from 1, but 1.0 is malformed (END-5). So each number that is not
// written as an integer becomes an object, which no check for an integer accepts. Use
// Number.isSafeInteger for these checks: it also rejects integers beyond 2^53-1.
const TOKEN = /"(?:[^"\\]|\\.)*"|-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?/g;

function parse(line) {
  return JSON.parse(line.replace(TOKEN, (token) =>
    token[0] === '"' || !/[.eE]/.test(token) ? token : JSON.stringify({ not_an_integer: token })));
}

// TODO: replace this with your station.
class Station {
  constructor(now, stationId, seed, parameters) {
    this.messages = []; // TODO: add each message that is sent
    this.indications = []; // TODO: add each indication to the application
  }

  // TODO: fire each timer whose deadline is `now` or earlier, in the order of protocol.md section 3.
  advance(now) {}

  // TODO: handle a message; `planned` is undefined unless an Advertisement concerns the station.
  receive(message, planned) {}

  // TODO: handle request, close, prescribe, proceed, complete, abort, accept and refuse.
  command(name, command) {}

  // TODO: the time (not the duration) of the earliest armed timer, or null.
  deadline() {
    return null;
  }

  // Everything since the last answer. TODO: add `phase` if the station can report it.
  answer() {
    const { messages, indications } = this;
    this.messages = [];
    this.indications = [];
    return { messages, indications, deadline: this.deadline() };
  }
}

let station = null;

function answer(line) {
  if (line.cmd === "hello") return ABOUT;
  if (line.cmd === "reset") {
    station = new Station(line.now, line.station, line.seed, line.parameters);
    return station.answer();
  }
  if (station === null) throw new Error("reset comes first");
  if (!["receive", "command", "advance"].includes(line.cmd)) {
    throw new Error(`unknown command ${line.cmd}`);
  }
  station.advance(line.now); // timers come before any other input of the same instant
  if (line.cmd === "receive") station.receive(line.message, line.planned);
  if (line.cmd === "command") station.command(line.command.name, line.command);
  return station.answer();
}

readline.createInterface({ input: process.stdin }).on("line", (text) => {
  let reply;
  try {
    const line = parse(text);
    if (line.cmd === "stop") process.exit(0);
    reply = answer(line);
  } catch (error) {
    reply = { error: String(error) };
  }
  process.stdout.write(JSON.stringify(reply) + "\n"); // print anything else to process.stderr
});
