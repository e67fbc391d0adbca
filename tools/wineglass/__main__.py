import sys

from wineglass.cli import main

sys.exit(main())
