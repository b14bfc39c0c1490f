/* The mode `ros1`: the loop as a node of ROS 1, between the robot's topics. */
#ifndef SPIDAR_ROS1_H
#define SPIDAR_ROS1_H

#ifdef __cplusplus
extern "C" {
#endif
/* Drive the robot of `robot_ns` after a mission's file until it is given back; commands go out under `out_ns`, which is
 * `robot_ns` or, for a dry run, another. `log` may be NULL. The exit status: of `sp_run_close`, or 2 where nothing
 * began. */
int sp_ros1(const char *mission, const char *robot_ns, const char *out_ns, const char *log, int residual);
#ifdef __cplusplus
}
#endif

#endif
