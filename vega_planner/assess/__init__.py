# SPDX-License-Identifier: Apache-2.0
"""How true a print is to its target: virtual prints, scans, comparison, compensation."""
