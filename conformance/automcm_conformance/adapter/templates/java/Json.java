import java.math.BigDecimal;
import java.util.ArrayList;
import java.util.LinkedHashMap;
import java.util.List;
import java.util.Map;

/**
 * A minimal JSON parser and writer. An integer becomes a Long; any other number, such as 1.0 or one
 * beyond 64 bits, becomes a BigDecimal, so that your station can reject it (END-5).
 */
final class Json {
    private final String text;
    private int at;

    private Json(String text) {
        this.text = text;
    }

    static Object parse(String text) {
        Json json = new Json(text);
        Object value = json.value();
        json.skip();
        if (json.at < text.length()) throw json.error();
        return value;
    }

    @SuppressWarnings("unchecked")
    static Map<String, Object> object(Object value) {
        if (!(value instanceof Map)) throw new IllegalArgumentException("an object is expected");
        return (Map<String, Object>) value;
    }

    private IllegalArgumentException error() {
        return new IllegalArgumentException("invalid JSON at character " + at);
    }

    private void skip() {
        while (at < text.length() && " \t\r\n".indexOf(text.charAt(at)) >= 0) at++;
    }

    private char peek() {
        skip();
        if (at >= text.length()) throw error();
        return text.charAt(at);
    }

    private boolean take(String token) {
        skip();
        if (!text.startsWith(token, at)) return false;
        at += token.length();
        return true;
    }

    private Object value() {
        switch (peek()) {
            case '{': return members();
            case '[': return items();
            case '"': return string();
            default:
                if (take("true")) return true;
                if (take("false")) return false;
                if (take("null")) return null;
                return number();
        }
    }

    private Map<String, Object> members() {
        Map<String, Object> found = new LinkedHashMap<>();
        take("{");
        if (take("}")) return found;
        do {
            if (peek() != '"') throw error();
            String name = string();
            if (!take(":")) throw error();
            found.put(name, value());
        } while (take(","));
        if (!take("}")) throw error();
        return found;
    }

    private List<Object> items() {
        List<Object> found = new ArrayList<>();
        take("[");
        if (take("]")) return found;
        do found.add(value()); while (take(","));
        if (!take("]")) throw error();
        return found;
    }

    private String string() {
        StringBuilder found = new StringBuilder();
        for (at++; at < text.length() && text.charAt(at) != '"'; at++) {
            char c = text.charAt(at);
            if (c == '\\') {
                if (++at >= text.length()) throw error();
                c = text.charAt(at);
                int known = "bfnrt".indexOf(c);
                if (known >= 0) {
                    c = "\b\f\n\r\t".charAt(known);
                } else if (c == 'u') {
                    if (at + 5 > text.length()) throw error();
                    c = (char) Integer.parseInt(text.substring(at + 1, at + 5), 16);
                    at += 4;
                }
            }
            found.append(c);
        }
        if (at >= text.length()) throw error();
        at++;
        return found.toString();
    }

    private Number number() {
        int begin = at;
        while (at < text.length() && "+-.eE0123456789".indexOf(text.charAt(at)) >= 0) at++;
        String digits = text.substring(begin, at);
        try {
            return Long.valueOf(digits);
        } catch (NumberFormatException notAnInteger) {
            return new BigDecimal(digits);
        }
    }

    static String text(Object value) {
        StringBuilder out = new StringBuilder();
        write(value, out);
        return out.toString();
    }

    private static void write(Object value, StringBuilder out) {
        if (value instanceof Map) {
            String before = "{";
            for (Map.Entry<String, Object> member : object(value).entrySet()) {
                out.append(before);
                write(member.getKey(), out);
                out.append(": ");
                write(member.getValue(), out);
                before = ", ";
            }
            out.append(before.equals("{") ? "{}" : "}");
        } else if (value instanceof List) {
            String before = "[";
            for (Object item : (List<?>) value) {
                out.append(before);
                write(item, out);
                before = ", ";
            }
            out.append(before.equals("[") ? "[]" : "]");
        } else if (value instanceof String) {
            out.append('"');
            for (char c : ((String) value).toCharArray()) {
                if (c == '"' || c == '\\') out.append('\\').append(c);
                else if (c < ' ' || c > '~') out.append(String.format("\\u%04x", (int) c));
                else out.append(c);
            }
            out.append('"');
        } else {
            out.append(value);
        }
    }
}
