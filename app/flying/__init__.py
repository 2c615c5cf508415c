"""How one moves: hands, cameras, and flights that are edited. Knows no session."""
