# SPDX-License-Identifier: Apache-2.0
"""The other end of the wire: emulated devices for tests and dry runs."""
