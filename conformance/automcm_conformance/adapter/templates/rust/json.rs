//! A minimal JSON parser and writer. A number that is not written as an integer of 64 bits, such as
//! 1.0, stays text in `Other`, so that your station can reject it (END-5).
use std::fmt;

#[derive(Clone, Debug, PartialEq)]
pub enum Json {
    Null,
    Bool(bool),
    Integer(i64),
    Other(String),
    Text(String),
    Array(Vec<Json>),
    Object(Vec<(String, Json)>),
}

impl Json {
    pub fn text(text: &str) -> Json {
        Json::Text(text.to_string())
    }

    pub fn object(members: Vec<(&str, Json)>) -> Json {
        Json::Object(members.into_iter().map(|(name, value)| (name.to_string(), value)).collect())
    }

    pub fn get(&self, name: &str) -> Option<&Json> {
        match self {
            Json::Object(members) => members.iter().find(|(key, _)| key == name).map(|(_, v)| v),
            _ => None,
        }
    }

    pub fn member(&self, name: &str) -> Result<&Json, String> {
        self.get(name).ok_or(format!("{name} is missing"))
    }

    pub fn as_text(&self) -> Result<&str, String> {
        if let Json::Text(text) = self { Ok(text) } else { Err(format!("not a text: {self}")) }
    }

    pub fn as_integer(&self) -> Result<i64, String> {
        if let Json::Integer(n) = self { Ok(*n) } else { Err(format!("not an integer: {self}")) }
    }

    pub fn parse(text: &str) -> Result<Json, String> {
        let mut parser = Parser { text, at: 0 };
        let value = parser.value()?;
        parser.skip();
        if parser.at < text.len() { parser.error() } else { Ok(value) }
    }
}

struct Parser<'a> {
    text: &'a str,
    at: usize,
}

impl Parser<'_> {
    fn error<T>(&self) -> Result<T, String> {
        Err(format!("invalid JSON at byte {}", self.at))
    }

    fn rest(&self) -> &str {
        &self.text[self.at..]
    }

    fn skip(&mut self) {
        self.at = self.text.len() - self.rest().trim_start().len();
    }

    fn take(&mut self, token: &str) -> bool {
        self.skip();
        let there = self.rest().starts_with(token);
        if there {
            self.at += token.len();
        }
        there
    }

    fn value(&mut self) -> Result<Json, String> {
        if self.take("{") {
            let mut members = vec![];
            while members.is_empty() || self.take(",") {
                if members.is_empty() && self.take("}") {
                    return Ok(Json::Object(members));
                }
                let name = if self.take("\"") { self.string()? } else { return self.error() };
                if !self.take(":") {
                    return self.error();
                }
                members.push((name, self.value()?));
            }
            return if self.take("}") { Ok(Json::Object(members)) } else { self.error() };
        }
        if self.take("[") {
            let mut items = vec![];
            while items.is_empty() || self.take(",") {
                if items.is_empty() && self.take("]") {
                    return Ok(Json::Array(items));
                }
                items.push(self.value()?);
            }
            return if self.take("]") { Ok(Json::Array(items)) } else { self.error() };
        }
        if self.take("\"") {
            return self.string().map(Json::Text);
        }
        for (token, value) in [("null", Json::Null), ("true", Json::Bool(true)), ("false", Json::Bool(false))] {
            if self.take(token) {
                return Ok(value);
            }
        }
        let end = |c: char| !"+-.eE0123456789".contains(c);
        let digits = self.rest().split(end).next().unwrap_or("").to_string();
        if digits.parse::<f64>().is_err() {
            return self.error();
        }
        self.at += digits.len();
        Ok(digits.parse().map(Json::Integer).unwrap_or(Json::Other(digits)))
    }

    fn string(&mut self) -> Result<String, String> {
        let mut units: Vec<u16> = vec![];
        while let Some(c) = self.rest().chars().next() {
            self.at += c.len_utf8();
            match c {
                '"' => return String::from_utf16(&units).or_else(|_| self.error()),
                '\\' => {
                    let escaped = self.rest().chars().next().unwrap_or(' ');
                    self.at += escaped.len_utf8();
                    match escaped {
                        'b' => units.push(8),
                        'f' => units.push(12),
                        'n' => units.push(10),
                        'r' => units.push(13),
                        't' => units.push(9),
                        '"' | '\\' | '/' => units.push(escaped as u16),
                        'u' => {
                            let digits = self.rest().get(..4).unwrap_or("");
                            match u16::from_str_radix(digits, 16) {
                                Ok(unit) => units.push(unit),
                                Err(_) => return self.error(),
                            }
                            self.at += 4;
                        }
                        _ => return self.error(),
                    }
                }
                _ => units.extend(c.encode_utf16(&mut [0; 2]).iter()),
            }
        }
        self.error()
    }
}

fn quoted(text: &str, out: &mut fmt::Formatter) -> fmt::Result {
    write!(out, "\"")?;
    for unit in text.encode_utf16() {
        match char::from_u32(unit as u32) {
            Some(c @ ('"' | '\\')) => write!(out, "\\{c}")?,
            Some(c @ ' '..='~') => write!(out, "{c}")?,
            _ => write!(out, "\\u{unit:04x}")?,
        }
    }
    write!(out, "\"")
}

impl fmt::Display for Json {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Json::Null => write!(out, "null"),
            Json::Bool(value) => write!(out, "{value}"),
            Json::Integer(n) => write!(out, "{n}"),
            Json::Other(digits) => write!(out, "{digits}"),
            Json::Text(text) => quoted(text, out),
            Json::Array(items) => {
                write!(out, "[")?;
                for (n, item) in items.iter().enumerate() {
                    write!(out, "{}{item}", if n > 0 { ", " } else { "" })?;
                }
                write!(out, "]")
            }
            Json::Object(members) => {
                write!(out, "{{")?;
                for (n, (name, value)) in members.iter().enumerate() {
                    write!(out, "{}", if n > 0 { ", " } else { "" })?;
                    quoted(name, out)?;
                    write!(out, ": {value}")?;
                }
                write!(out, "}}")
            }
        }
    }
}
