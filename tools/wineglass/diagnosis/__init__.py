"""Where does a recording differ from the twin, which effect is it, and how sure can one be? docs/DIAGNOSIS.md argues the procedure."""
