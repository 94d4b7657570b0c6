"""Names of the GPUs and the driver of this machine, read without starting Taichi."""

import contextlib
import ctypes
import platform
import subprocess
import sys

# Size of VkInstanceCreateInfo [words of 8 bytes], and a size [bytes] that holds
# VkPhysicalDeviceProperties.
INFO_WORDS, PROPERTIES = 8, 4096
# VkPhysicalDeviceProperties begins with five 32-bit numbers (API version, driver version, vendor,
# device, type) and the name [bytes].
NUMBERS, NAME_LENGTH = 5, 256
# Names of the driver libraries on this system.
CUDA = {"win32": "nvcuda.dll"}.get(sys.platform, "libcuda.so.1")
VULKAN = {"win32": "vulkan-1.dll", "darwin": "libvulkan.1.dylib"}.get(
    sys.platform, "libvulkan.so.1"
)
# Largest number of Vulkan devices that are named.
MOST = 16


def gpu_name(arch: str) -> str | None:
    """Returns names and driver versions of the GPUs of `arch`: the first for cuda, all for vulkan,
    the chip for metal; None if the machine has no such GPU or does not name it."""
    with contextlib.suppress(OSError, AttributeError, subprocess.SubprocessError):
        return {"cuda": _cuda, "vulkan": _vulkan, "metal": _metal}[arch]()
    return None


def _cuda() -> str | None:
    driver, count, version = ctypes.CDLL(CUDA), ctypes.c_int(), ctypes.c_int()
    if driver.cuInit(0) or driver.cuDeviceGetCount(ctypes.byref(count)) or not count.value:
        return None
    driver.cuDriverGetVersion(ctypes.byref(version))
    name = ctypes.create_string_buffer(NAME_LENGTH)
    driver.cuDeviceGetName(name, NAME_LENGTH, 0)
    return f"{name.value.decode(errors='replace')}, CUDA {version.value}"


def _vulkan() -> str | None:
    loader, instance = ctypes.CDLL(VULKAN), ctypes.c_void_p()
    # The structure's type, VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO, is 1; all other members are 0.
    info = (ctypes.c_uint64 * INFO_WORDS)(1)
    if loader.vkCreateInstance(info, None, ctypes.byref(instance)):
        return None
    count, devices = ctypes.c_uint32(MOST), (ctypes.c_void_p * MOST)()
    loader.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), devices)
    found = []
    for device in devices[: count.value]:
        properties = ctypes.create_string_buffer(PROPERTIES)
        loader.vkGetPhysicalDeviceProperties(ctypes.c_void_p(device), properties)
        driver = ctypes.cast(properties, ctypes.POINTER(ctypes.c_uint32))[1]
        name = properties.raw[4 * NUMBERS : 4 * NUMBERS + NAME_LENGTH]
        found.append(f"{name.split(bytes(1))[0].decode(errors='replace')}, driver {driver:#x}")
    loader.vkDestroyInstance(instance, None)
    return "; ".join(found) or None


def _metal() -> str | None:
    if sys.platform != "darwin":
        return None
    asked = ["sysctl", "-n", "machdep.cpu.brand_string"]
    chip = subprocess.run(asked, capture_output=True, text=True, check=True, timeout=5.0)
    return f"{chip.stdout.strip()}, macOS {platform.mac_ver()[0]}"
