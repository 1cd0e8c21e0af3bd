// Lines in, lines out. An answer is held back only while a whole further line is already here: so
// a kit that writes many commands at once pays for few system calls, and one that waits is never
// kept waiting.
#pragma once

#include <cerrno>
#include <cstdlib>
#include <string>

#include <unistd.h>

class Lines {
public:
    // The next line without its line feed; false at the end of the input.
    bool next(std::string& line) {
        for (;;) {
            const std::size_t end = input_.find('\n', start_);
            if (end != std::string::npos) {
                line.assign(input_, start_, end - start_);
                start_ = end + 1;
                return true;
            }
            flush();
            input_.erase(0, start_);
            start_ = 0;
            if (read_more()) continue;
            line.swap(input_);
            input_.clear();
            return !line.empty();      // a last line without a line feed
        }
    }

    void write(const std::string& line) {
        output_ += line;
        output_ += '\n';
        if (output_.size() > block) flush();
    }

    void flush() {
        for (std::size_t done = 0; done < output_.size();) {
            const ssize_t count = ::write(STDOUT_FILENO, output_.data() + done, output_.size() - done);
            if (count < 0 && errno != EINTR) std::exit(1);       // nobody reads any more
            if (count > 0) done += static_cast<std::size_t>(count);
        }
        output_.clear();
    }

private:
    static constexpr std::size_t block = 65536;
    std::string input_, output_;
    std::size_t start_ = 0;

    bool read_more() {
        char bytes[block];
        ssize_t count;
        do {
            count = ::read(STDIN_FILENO, bytes, block);
        } while (count < 0 && errno == EINTR);
        if (count > 0) input_.append(bytes, static_cast<std::size_t>(count));
        return count > 0;
    }
};
