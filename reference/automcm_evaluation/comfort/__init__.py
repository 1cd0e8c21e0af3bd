"""Speed and braking of each vehicle, with and without faults: section VI-B and figure 6."""
