#!/bin/sh
# Makes the plain comment that opens a header the documentation of that file, for Doxygen. What is
# indented in it is code, set off by an empty line.
exec awk '
  NR == 1 { print "/// @file"; opening = 1 }
  !/^\/\// { opening = 0 }
  !opening { print; next }
  /^\/\/   / { if (!code) print "///"; code = 1; sub(/^\/\/   /, "///      "); print; next }
  { if (code) print "///"; code = 0; sub(/^\/\//, "///"); print }
' "$1"
