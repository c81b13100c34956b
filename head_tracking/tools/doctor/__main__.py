"""Makes `python3 -m head_tracking.tools.doctor` work, also where nothing is installed."""

from head_tracking.tools.doctor.main import main

raise SystemExit(main())
