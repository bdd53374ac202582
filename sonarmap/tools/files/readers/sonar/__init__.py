"""What does a recording of a Sonar 3D-15 hold? Packets one by one, messages, shots in order, attitude from its IMU.

In: a `.sonar` file. Out: frames with strengths, stamps and priors, and what was lost or damaged.
"""
