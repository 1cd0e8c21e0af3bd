"""Who brakes, how hard, and when? Section VI-B and figure 6 of the paper.

Courses of speed and gap of each vehicle.
Only ``runs`` imports it.
"""
