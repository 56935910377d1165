# SPDX-License-Identifier: Apache-2.0
"""Motion controllers: simulated axes, EtherCAT drives (CiA 402)."""
