"""How flows are followed: closed forms, margins that are watched along them, and where these change sign."""
