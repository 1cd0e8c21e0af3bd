// An adapter for the AutoMCM conformance kit: it translates lines to calls of your station.
//
//     automcm conform check-adapter -- ./run      # is each line valid?
//     automcm conform run -- ./run                # is the station correct?
//
// It implements the whole adapter protocol, but the station is empty. Work through the TODOs.
// Json.java is a minimal parser. Any library may replace it that can tell 1.0 from 1.
import java.io.BufferedReader;
import java.io.InputStreamReader;
import java.io.PrintStream;
import java.nio.charset.StandardCharsets;
import java.util.ArrayList;
import java.util.List;
import java.util.Map;
import java.util.TreeMap;

public class Adapter {
    static final Map<String, Object> ABOUT = Map.of(
        "protocol", 1L,
        "name", "my station", // TODO
        "version", "0.1", // TODO
        "issues", "where to report a bug in it", // TODO
        "features", List.of("prescriber", "receiver"), // TODO: restart, durations, cam
        "scenarios", List.of("lane_change"), // TODO: scenarios that a request may name
        "fixed", Map.of()); // TODO: parameters that cannot be changed

    /** TODO: replace this with your station. */
    static class Station {
        private List<Object> messages = new ArrayList<>(); // TODO: add each message that is sent
        private List<Object> indications = new ArrayList<>(); // TODO: add each indication

        Station(long now, long stationId, long seed, Map<String, Object> parameters) {}

        /** TODO: fire each timer due at now or earlier, in the order of protocol.md section 3. */
        void advance(long now) {}

        /** TODO: handle a message; planned is null unless an Advertisement concerns the station. */
        void receive(Map<String, Object> message, Object planned) {}

        /** TODO: handle request, close, prescribe, proceed, complete, abort, accept and refuse. */
        void command(String name, Map<String, Object> command) {}

        /** TODO: the time (not the duration) of the earliest armed timer, or null. */
        Long deadline() {
            return null;
        }

        /** Everything since the last answer. TODO: add "phase" if the station can report it. */
        Map<String, Object> answer() {
            Map<String, Object> answer = new TreeMap<>();
            answer.put("messages", messages);
            answer.put("indications", indications);
            answer.put("deadline", deadline());
            messages = new ArrayList<>();
            indications = new ArrayList<>();
            return answer;
        }
    }

    private Station station;

    Map<String, Object> answer(Map<String, Object> line) {
        String cmd = (String) line.get("cmd");
        if (cmd.equals("hello")) return ABOUT;
        if (cmd.equals("reset")) {
            station = new Station((Long) line.get("now"), (Long) line.get("station"),
                (Long) line.get("seed"), Json.object(line.get("parameters")));
            return station.answer();
        }
        if (station == null) throw new IllegalStateException("reset comes first");
        if (!List.of("receive", "command", "advance").contains(cmd)) {
            throw new IllegalArgumentException("unknown command " + cmd);
        }
        station.advance((Long) line.get("now")); // timers before any input of the same instant
        if (cmd.equals("receive")) {
            station.receive(Json.object(line.get("message")), line.get("planned"));
        }
        if (cmd.equals("command")) {
            Map<String, Object> command = Json.object(line.get("command"));
            station.command((String) command.get("name"), command);
        }
        return station.answer();
    }

    public static void main(String[] arguments) throws Exception {
        Adapter adapter = new Adapter();
        BufferedReader input = new BufferedReader(
            new InputStreamReader(System.in, StandardCharsets.UTF_8));
        PrintStream output = new PrintStream(System.out, true, StandardCharsets.UTF_8);
        for (String text = input.readLine(); text != null; text = input.readLine()) {
            Map<String, Object> reply;
            try {
                Map<String, Object> line = Json.object(Json.parse(text));
                if ("stop".equals(line.get("cmd"))) return;
                reply = adapter.answer(line);
            } catch (RuntimeException | StackOverflowError error) {
                reply = Map.of("error", String.valueOf(error));
            }
            output.print(Json.text(reply) + "\n"); // print anything else to System.err
            output.flush();
        }
    }
}
