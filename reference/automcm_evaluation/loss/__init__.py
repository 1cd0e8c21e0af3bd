"""Sessions and drives under message loss, also on UDP sockets: section VI-C of the paper."""
