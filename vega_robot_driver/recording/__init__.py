# SPDX-License-Identifier: Apache-2.0
"""A recording of every print, in a file that common tools read."""
