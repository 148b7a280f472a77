"""Health: of a head (`sight`, `floor`) and of the robots' poses (`agreement`); `findings`."""
