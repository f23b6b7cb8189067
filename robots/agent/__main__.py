"""`python -m robots.agent NAME --server URL --credentials FILE`: the agent without Django."""

import sys

from robots.agent.agent import main

if __name__ == "__main__":
    sys.exit(main())
