"""DDS Security (SROS 2): a node that requires it has it, or does not start."""

from __future__ import annotations

from collections.abc import Mapping

from mrs_people_loc.errors import ConfigError

ENABLE, STRATEGY, KEYSTORE = (
    "ROS_SECURITY_ENABLE",
    "ROS_SECURITY_STRATEGY",
    "ROS_SECURITY_KEYSTORE",
)


def asked(environment: Mapping[str, str]) -> str:
    """How much security is requested of a node.

    rcl knows `true` and `Enforce`; it takes any other value for "no".

    Args:
        environment: Environment variables.

    Returns:
        `Enforce`, `Permissive`, or an empty text if none is requested.

    Raises:
        ConfigError: A value would be misunderstood.
    """
    enable, strategy = environment.get(ENABLE, ""), environment.get(STRATEGY, "")
    if enable not in ("", "true", "false"):
        raise ConfigError(f"{ENABLE} is {enable!r}; allowed: true or false")
    if strategy not in ("", "Enforce", "Permissive"):
        raise ConfigError(f"{STRATEGY} is {strategy!r}; allowed: Enforce or Permissive")
    if strategy == "Enforce" and not enable:
        raise ConfigError(
            f"{STRATEGY} is Enforce, but {ENABLE} is not set, so nothing would be enforced; "
            "allowed: true, or false to go without security"
        )
    return (strategy or "Permissive") if enable == "true" else ""


def refusal(error: Exception, environment: Mapping[str, str]) -> ConfigError:
    """Why a node that requires security does not start.

    Args:
        error: What rclpy raised.
        environment: Environment variables.
    """
    if "security libraries" in str(error):
        why = (
            "the Fast DDS of this installation is built without its security plugin; "
            "take ROS from Ubuntu's packages, or the tunnel of `mrs keys`"
        )
    else:
        why = (
            f"no keys for this node ({KEYSTORE} is {environment.get(KEYSTORE, '')!r}, and its "
            f"enclave is named with --ros-args --enclave /NAME): {error}"
        )
    return ConfigError(f"security was asked for with {ENABLE}=true and cannot be had: {why}")


#: Logged by a node that has to try security, but not to require it.
UNSURE = (
    f"{ENABLE} is true, but {STRATEGY} is not Enforce: without keys this node runs UNPROTECTED, "
    "and only DDS knows whether it has any; set Enforce to be sure"
)
