"""What does a Sonar 3D-15 send now? Its packets from the network to a `.sonar` file, and how that goes.

In: UDP datagrams. Out: a file with the sonar's packets as they came, and what was lost, late or damaged on the way.
"""
