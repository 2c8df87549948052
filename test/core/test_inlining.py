"""How kernels are compiled: so that the same frame gives the same bits in every process."""

from __future__ import annotations

import importlib
import pkgutil

from numba.core.registry import CPUDispatcher

from rsmb_ros.core import _kernels


def test_kernels_that_kernels_call_exist_once():
    """Else a fresh compilation and numba's cache give results that differ in their last bits."""
    kernels = {}
    for module in pkgutil.iter_modules(_kernels.__path__, f'{_kernels.__name__}.'):
        for kernel in vars(importlib.import_module(module.name)).values():
            if isinstance(kernel, CPUDispatcher) and kernel.targetoptions.get('fastmath'):
                kernels[kernel.py_func.__name__] = kernel
    called = {
        name for kernel in kernels.values() for name in kernel.py_func.__code__.co_names
    } & kernels.keys()
    assert len(called) > 20
    loose = [
        name
        for name in called
        if not kernels[name].targetoptions.get('forceinline')
        and kernels[name].targetoptions.get('inline') != 'always'
    ]
    assert not loose, f'{sorted(loose)} are called by kernels: take INLINED, or inline="always"'
