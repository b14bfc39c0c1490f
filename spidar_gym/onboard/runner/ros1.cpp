/* The mode `ros1`: runs the loop at 40 Hz between ROS 1 topics. C++11 and later, up to C++17. */
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <deque>
#include <exception>
#include <string>
#include <vector>

#include <sched.h>
#include <sys/mman.h>

#include <geometry_msgs/PoseStamped.h>
#include <nav_msgs/Odometry.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <ros/xmlrpc_manager.h>
#include <sensor_msgs/JointState.h>
#include <spinal/FlightConfigCmd.h>
#include <spinal/FourAxisCommand.h>
#include <spinal/Imu.h>
#include <spinal/Pwms.h>
#include <spinal/ServoStates.h>
#include <std_msgs/Float32.h>
#include <std_msgs/String.h>
#include <std_msgs/UInt8.h>

#include "runner.h"

namespace {

const int LANDINGS = 5;             /* landing commands before exit */
const double LISTEN = 2.0, WAIT = 5.0, LEAST = 1.0; /* to topics at start; at most for a missing one; then to it [s] */
const int PRIORITY = 50;            /* of SCHED_FIFO */
const int64_t SECOND = 1000000000;  /* [ns] */
const char *const NODE = "spidar_runner";

volatile sig_atomic_t signalled = 0;
volatile sig_atomic_t dismissed = 0; /* by `rosnode kill`, or by another node of the same name */

void on_signal(int number) { signalled = number; }

/* Replaces ROS's handler of `shutdown`, which closes every connection at once, before a landing can be commanded. */
void on_shutdown(XmlRpc::XmlRpcValue &, XmlRpc::XmlRpcValue &result)
{
    dismissed = 1;
    result = ros::xmlrpc::responseInt(1, "", 0);
}

/* Fields of the inertial unit: their names differ between the HEAD of the lab's package and SPIDAR's branch. */
template <class M> auto gyro_of(const M &m, int) -> decltype((m.gyro_data)) { return m.gyro_data; }
template <class M> auto gyro_of(const M &m, long) -> decltype((m.gyro)) { return m.gyro; }
template <class M> auto acc_of(const M &m, int) -> decltype((m.acc_data)) { return m.acc_data; }
template <class M> auto acc_of(const M &m, long) -> decltype((m.acc)) { return m.acc; }

int64_t monotonic()
{
    timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * SECOND + t.tv_nsec;
}

void sleep_until(int64_t due)
{
    timespec t;
    t.tv_sec = due / SECOND;
    t.tv_nsec = due % SECOND;
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) == EINTR && !signalled) {}
}

/* Message count of a topic. */
struct Arrivals {
    int count;
    int64_t first; /* [ns] */
};

class Robot {
public:
    Robot(const std::string &robot_ns, const std::string &out_ns, const sp_mission &mission)
        : in_(robot_ns), out_(out_ns), dry_(in_.getNamespace() != out_.getNamespace()),
          odometry_(mission.odometry != 0), base_(ros::Time::now().sec), heard_until_(0), changed_(false)
    {
        std::memset(&input_, 0, sizeof input_);
        std::memset(arrivals_, 0, sizeof arrivals_);
        input_.flight_state = -1;
        for (int k = 0; k < SP_JOINTS; k++) input_.measurement.joint_position[k] = NAN;
        for (int k = 0; k < 2 * SP_ROTORS; k++) input_.measurement.vectoring[k] = NAN;
        input_.measurement.encoder_time = input_.flight_state_time = -1e9; /* never */
        input_.health.voltage_time = input_.health.servo_time = input_.health.motor_time = -1e9;
        subscribe();
        advertise();
    }

    /* Listen until the rates are measured; returns 0 if a signal ended it. */
    int listen()
    {
        const int64_t start = monotonic();
        int64_t end = start + (int64_t)(LISTEN * SECOND), last = start + (int64_t)(WAIT * SECOND);
        while (monotonic() < end) {
            ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.02));
            if (signalled || dismissed || !ros::ok()) return 0;
            for (int topic = 0; topic < SP_TOPICS; topic++) {
                if (!wanted(topic)) continue;
                const int64_t first = arrivals_[topic].count > 0 ? arrivals_[topic].first : monotonic();
                const int64_t enough = first + (int64_t)(LEAST * SECOND);
                if (enough > end) end = enough < last ? enough : last;
            }
        }
        heard_until_ = monotonic();
        return 1;
    }

    /* Properties of the robot for sp_agree; the pointers are valid as long as this object. */
    sp_found found()
    {
        sp_found robot;
        robot.model = in_.getParam("spidar_model_sha256", model_) ? model_.c_str() : NULL;
        words_.clear();
        for (size_t k = 0; k < names_.size(); k++) words_.push_back(names_[k].c_str());
        robot.name_count = (int32_t)words_.size();
        robot.names = words_.data();
        for (int topic = 0; topic < SP_TOPICS; topic++) {
            const Arrivals &a = arrivals_[topic];
            const double window = 1e-9 * (double)(heard_until_ - a.first);
            robot.rates[topic] = a.count > 0 && window > 0.0 ? (double)a.count / window : 0.0;
        }
        return robot;
    }

    /* Collect the messages since the last tick. */
    const sp_loop_input &receive(int stage)
    {
        sp_measurement &m = input_.measurement;
        m.pose_count = m.imu_count = 0;
        input_.has_odometry = input_.has_thrust = 0;
        changed_ = false;
        std::memset(input_.orders, 0, sizeof input_.orders);
        ros::getGlobalCallbackQueue()->callAvailable();
        if (!orders_.empty()) { /* one message a tick */
            std::memcpy(input_.orders, orders_.front().data(), orders_.front().size());
            orders_.pop_front();
        }
        if (changed_)
            for (int k = 0; k < SP_JOINTS; k++) m.joint_position[k] = NAN;
        /* In a dry run the robot's own flight stack keeps commanding: that is no contention with the runner. */
        if (dry_ && stage != SP_WAITING) input_.has_thrust = 0;
        input_.time = m.time = seconds(ros::Time::now());
        return input_;
    }

    void act(const sp_loop_output &output)
    {
        if (output.action == SP_PUBLISH) publish(output.command);
        if (output.action == SP_FORCE_LANDING) land();
    }

    void land() { config_.publish(landing_); }

    bool dry() const { return dry_; }

    /* Name of another runner that drives already, or empty. */
    const std::string &rival() const { return rival_; }

private:
    ros::NodeHandle in_, out_;
    const bool dry_, odometry_;
    const int64_t base_; /* whole seconds, which avoids rounding */
    ros::Subscriber subscribers_[9];
    ros::Publisher thrust_, gimbals_, joints_, torques_, config_;
    spinal::FourAxisCommand thrust_message_;
    sensor_msgs::JointState gimbals_message_, joints_message_, torques_message_;
    spinal::FlightConfigCmd landing_;
    sp_loop_input input_;
    Arrivals arrivals_[SP_TOPICS];
    int64_t heard_until_;
    std::vector<std::string> names_; /* of `joint_states`, as at start */
    std::vector<const char *> words_;
    std::vector<double *> positions_, efforts_; /* target of each name, or NULL */
    std::string model_, rival_;
    std::deque<std::string> orders_; /* for the next ticks */
    bool changed_; /* whether a message since the last tick had other names than at start */

    double seconds(const ros::Time &t) const { return (double)((int64_t)t.sec - base_) + 1e-9 * (double)t.nsec; }

    bool wanted(int topic) const
    {
        return topic < SP_FIRST_HEALTH && !(topic == SP_TOPIC_POSE && odometry_) && !(topic == SP_TOPIC_ODOMETRY && !odometry_);
    }

    void came(sp_topic topic)
    {
        Arrivals &a = arrivals_[topic];
        if (a.count++ == 0) a.first = monotonic();
    }

    void subscribe()
    {
        const ros::TransportHints fast = ros::TransportHints().tcpNoDelay();
        subscribers_[0] = in_.subscribe("joint_states", 8, &Robot::on_joints, this, fast);
        subscribers_[1] = in_.subscribe("imu", 64, &Robot::on_imu, this, fast);
        if (odometry_) subscribers_[2] = in_.subscribe("uav/cog/odom", 8, &Robot::on_odometry, this, fast);
        else subscribers_[2] = in_.subscribe("mocap/pose", 32, &Robot::on_pose, this, fast);
        subscribers_[3] = in_.subscribe("flight_state", 8, &Robot::on_state, this, fast);
        subscribers_[4] = in_.subscribe("four_axes/command", 8, &Robot::on_thrust, this, fast);
        subscribers_[5] = in_.subscribe("runner/orders", 8, &Robot::on_orders, this, fast);
        subscribers_[6] = in_.subscribe("battery_voltage_status", 2, &Robot::on_voltage, this, fast);
        subscribers_[7] = in_.subscribe("servo/states", 2, &Robot::on_servos, this, fast);
        subscribers_[8] = in_.subscribe("motor_pwms", 2, &Robot::on_motors, this, fast);
    }

    void advertise()
    {
        /* Short queues: a command is obsolete when the next one is sent. */
        thrust_ = out_.advertise<spinal::FourAxisCommand>("four_axes/command", 2);
        gimbals_ = out_.advertise<sensor_msgs::JointState>("gimbals_ctrl", 2);
        joints_ = out_.advertise<sensor_msgs::JointState>("joints_ctrl", 2);
        torques_ = out_.advertise<sensor_msgs::JointState>("joints_torque_ctrl", 2);
        config_ = out_.advertise<spinal::FlightConfigCmd>("flight_config_cmd", 2 * LANDINGS);
        thrust_message_.angles.fill(0.0f);
        thrust_message_.base_thrust.assign(SP_ROTORS, 0.0f);
        gimbals_message_.name.assign(SP_GIMBAL_NAMES, SP_GIMBAL_NAMES + 2 * SP_ROTORS);
        gimbals_message_.position.assign(2 * SP_ROTORS, 0.0);
        joints_message_.name.assign(SP_JOINT_NAMES, SP_JOINT_NAMES + SP_JOINTS);
        joints_message_.position.assign(SP_JOINTS, 0.0);
        torques_message_.name = joints_message_.name;
        torques_message_.effort.assign(SP_JOINTS, 0.0);
        landing_.cmd = spinal::FlightConfigCmd::FORCE_LANDING_CMD;
    }

    void publish(const sp_command &command)
    {
        const ros::Time now = ros::Time::now();
        for (int i = 0; i < SP_ROTORS; i++) thrust_message_.base_thrust[i] = (float)command.thrust[i];
        for (int k = 0; k < 2 * SP_ROTORS; k++) gimbals_message_.position[k] = command.vectoring[k];
        for (int k = 0; k < SP_JOINTS; k++) {
            joints_message_.position[k] = command.joint_position[k];
            torques_message_.effort[k] = command.joint_torque_limit[k];
        }
        gimbals_message_.header.stamp = joints_message_.header.stamp = torques_message_.header.stamp = now;
        thrust_.publish(thrust_message_);
        gimbals_.publish(gimbals_message_);
        joints_.publish(joints_message_);
        torques_.publish(torques_message_);
    }

    /* Map each name to its member of the measurement. */
    void map_names(const std::vector<std::string> &names)
    {
        sp_measurement &m = input_.measurement;
        names_ = names;
        positions_.assign(names.size(), NULL);
        efforts_.assign(names.size(), NULL);
        for (size_t n = 0; n < names.size(); n++)
            for (int k = 0; k < SP_JOINTS; k++) {
                if (names[n] == SP_JOINT_NAMES[k]) {
                    positions_[n] = &m.joint_position[k];
                    efforts_[n] = &m.joint_torque[k];
                }
                if (names[n] == SP_GIMBAL_NAMES[k]) positions_[n] = &m.vectoring[k];
            }
    }

    void on_joints(const sensor_msgs::JointState::ConstPtr &message)
    {
        came(SP_TOPIC_JOINTS);
        if (names_.empty()) map_names(message->name);
        input_.measurement.encoder_time = seconds(message->header.stamp);
        if (message->name != names_) {
            changed_ = true;
            return;
        }
        for (size_t n = 0; n < names_.size(); n++) {
            if (positions_[n] != NULL) *positions_[n] = n < message->position.size() ? message->position[n] : NAN;
            /* The servos report currents less often than angles: a missing effort is no fault. */
            if (efforts_[n] != NULL && n < message->effort.size()) *efforts_[n] = message->effort[n];
        }
    }

    void on_imu(const spinal::Imu::ConstPtr &message)
    {
        sp_measurement &m = input_.measurement;
        came(SP_TOPIC_IMU);
        if (m.imu_count == SP_IMU_SAMPLES) { /* keep the newest */
            m.imu_count--;
            std::memmove(m.imu_time, m.imu_time + 1, (SP_IMU_SAMPLES - 1) * sizeof(double));
            std::memmove(m.gyro_b, m.gyro_b + 3, (SP_IMU_SAMPLES - 1) * 3 * sizeof(double));
            std::memmove(m.specific_force_b, m.specific_force_b + 3, (SP_IMU_SAMPLES - 1) * 3 * sizeof(double));
        }
        const int k = m.imu_count++;
        m.imu_time[k] = seconds(message->stamp);
        for (int i = 0; i < 3; i++) {
            m.gyro_b[3 * k + i] = gyro_of(*message, 0)[i];
            m.specific_force_b[3 * k + i] = acc_of(*message, 0)[i];
        }
    }

    template <class V> static void take_xyz(const V &vector, double *to)
    {
        to[0] = vector.x;
        to[1] = vector.y;
        to[2] = vector.z;
    }

    static void take_pose(const geometry_msgs::Pose &pose, double *position_w, double *quat_wb)
    {
        take_xyz(pose.position, position_w);
        quat_wb[0] = pose.orientation.w;
        take_xyz(pose.orientation, quat_wb + 1);
    }

    void on_pose(const geometry_msgs::PoseStamped::ConstPtr &message)
    {
        sp_measurement &m = input_.measurement;
        came(SP_TOPIC_POSE);
        if (m.pose_count == SP_POSE_FRAMES) {
            m.pose_count--;
            std::memmove(m.pose_time, m.pose_time + 1, (SP_POSE_FRAMES - 1) * sizeof(double));
            std::memmove(m.pose_position_w, m.pose_position_w + 3, (SP_POSE_FRAMES - 1) * 3 * sizeof(double));
            std::memmove(m.pose_quat_wb, m.pose_quat_wb + 4, (SP_POSE_FRAMES - 1) * 4 * sizeof(double));
        }
        const int k = m.pose_count++;
        m.pose_time[k] = seconds(message->header.stamp);
        take_pose(message->pose, m.pose_position_w + 3 * k, m.pose_quat_wb + 4 * k);
    }

    void on_odometry(const nav_msgs::Odometry::ConstPtr &message)
    {
        sp_odometry &o = input_.odometry;
        came(SP_TOPIC_ODOMETRY);
        input_.has_odometry = 1;
        o.time = seconds(message->header.stamp);
        take_pose(message->pose.pose, o.position_w, o.quat_wb);
        take_xyz(message->twist.twist.linear, o.velocity_w);
        take_xyz(message->twist.twist.angular, o.omega_b);
    }

    void on_state(const ros::MessageEvent<std_msgs::UInt8 const> &event)
    {
        came(SP_TOPIC_STATE);
        input_.flight_state = event.getMessage()->data;
        input_.flight_state_time = seconds(event.getReceiptTime()); /* the message has no stamp */
    }

    void on_voltage(const ros::MessageEvent<std_msgs::Float32 const> &event)
    {
        came(SP_TOPIC_VOLTAGE);
        input_.health.voltage = event.getMessage()->data;
        input_.health.voltage_time = seconds(event.getReceiptTime()); /* the message has no stamp */
    }

    void on_servos(const spinal::ServoStates::ConstPtr &message)
    {
        sp_health_input &h = input_.health;
        came(SP_TOPIC_SERVOS);
        h.servo_time = seconds(message->stamp);
        h.servo_count = 0;
        for (const auto &servo : message->servos) {
            if (servo.index >= SP_SERVOS) continue;
            h.servo_count++;
            h.servo_angle[servo.index] = servo.angle;
            h.servo_temperature[servo.index] = servo.temp;
            h.servo_load[servo.index] = servo.load;
            h.servo_error[servo.index] = servo.error;
        }
    }

    void on_motors(const spinal::Pwms::ConstPtr &message)
    {
        sp_health_input &h = input_.health;
        came(SP_TOPIC_MOTORS);
        h.motor_time = seconds(message->stamp);
        h.motor_count = (int32_t)message->motor_value.size();
        for (int k = 0; k < SP_ROTORS && k < h.motor_count; k++) h.motor_output[k] = message->motor_value[k];
    }

    void on_orders(const std_msgs::String::ConstPtr &message)
    {
        if (message->data.size() < sizeof input_.orders) orders_.push_back(message->data);
        else std::fprintf(stderr, "runner: orders refused; valid: at most %d characters\n", SP_ORDER_TEXT - 1);
    }

    void on_thrust(const ros::MessageEvent<spinal::FourAxisCommand const> &event)
    {
        const spinal::FourAxisCommand &message = *event.getMessage();
        const std::string &from = event.getPublisherName();
        /* The robot ignores commands for another number of rotors, so they are ignored here too. */
        if (from == ros::this_node::getName() || message.base_thrust.size() != SP_ROTORS) return;
        if (from.find(std::string("/") + NODE + "_") != std::string::npos) rival_ = from;
        input_.has_thrust = 1;
        for (int i = 0; i < SP_ROTORS; i++) input_.thrust[i] = message.base_thrust[i];
    }
};

void handle_signals()
{
    struct sigaction action;
    std::memset(&action, 0, sizeof action);
    action.sa_handler = on_signal;
    sigemptyset(&action.sa_mask);
    const int numbers[] = {SIGINT, SIGTERM, SIGHUP}; /* HUP: the operator's terminal was closed */
    for (int number : numbers) sigaction(number, &action, NULL);
}

/* Set real-time priority before ROS starts its threads: they inherit it, so messages arrive in time for the tick. */
bool be_urgent()
{
    sched_param priority;
    std::memset(&priority, 0, sizeof priority);
    priority.sched_priority = PRIORITY;
    return sched_setscheduler(0, SCHED_FIFO, &priority) == 0;
}

/* Run ticks until the robot is released or a signal arrives; returns whether the runner still drives. */
bool drive(Robot &robot, sp_run *run)
{
    static sp_loop_output output;
    const int64_t period = (int64_t)((double)SECOND / sp_control_rate());
    int64_t due = monotonic() + period;
    std::memset(&output, 0, sizeof output);
    output.stage = SP_WAITING;
    while (!signalled && !dismissed && ros::ok()) {
        sleep_until(due);
        if (signalled) break;
        const sp_loop_input &input = robot.receive(output.stage);
        sp_run_tick(run, &input, &output, 1e-3 * (double)(monotonic() - due));
        robot.act(output);
        if (output.stage == SP_RELEASED) {
            std::fprintf(stderr, "runner: ends: %s, %s\n", sp_stage_words(output.stage), sp_fault_words(output.fault));
            return false;
        }
        due += period;
        const int64_t late = monotonic() - due;
        if (late > 0) due += (late / period + 1) * period; /* skip missed ticks instead of a burst */
    }
    return output.stage != SP_WAITING;
}

/* Command the landing before exit, so that Ctrl-C does not leave the robot with its last command. */
void leave(Robot &robot, bool driving)
{
    const char *why = signalled ? "a signal" : dismissed ? "rosnode kill" : "the end of ROS";
    std::fprintf(stderr, "runner: ends by %s: %s\n", why, !driving ? "nothing was sent" : robot.dry()
                 ? "commands FORCE_LANDING in its dry run and exits" : "commands FORCE_LANDING and exits");
    for (int k = 0; driving && k < LANDINGS; k++) {
        robot.land();
        ros::WallDuration(1.0 / sp_control_rate()).sleep();
    }
}

/* Check the robot and drive it, once a master exists. */
int serve(sp_run *run, const char *model, const char *robot_ns, const char *out_ns)
{
    static char reason[512];
    bool urgent = be_urgent();
    ros::start();
    ros::XMLRPCManager::instance()->unbind("shutdown");
    ros::XMLRPCManager::instance()->bind("shutdown", on_shutdown);
    if (ros::Time::isSimTime())
        return sp_reject("ROS parameter ", "/use_sim_time is set; valid: a robot with its own clock");
    Robot robot(robot_ns, out_ns, run->loop.mission);
    if (!robot.listen()) return sp_reject("", "ended before the robot's messages arrived");
    if (!robot.dry() && !robot.rival().empty())
        return sp_reject(robot.rival().c_str(), " drives the robot already; valid: one runner at a time");
    const sp_found found = robot.found();
    if (!sp_agree(&found, model, run->loop.mission.odometry, reason, sizeof reason)) return sp_reject("", reason);
    sp_say_absent(&found);
    /* Lock the present memory only: later allocations must not fail because of a limit on locked memory. */
    urgent = mlockall(MCL_CURRENT) == 0 && urgent;
    if (!urgent) std::fprintf(stderr, "runner: runs without real-time priority or locked memory: the system refused\n");
    const bool driving = drive(robot, run);
    if (signalled || dismissed || !ros::ok()) leave(robot, driving);
    ros::WallDuration(0.1).sleep(); /* ROS sends in another thread: wait for the last messages */
    return 0;
}

} /* namespace */

extern "C" int sp_ros1(const sp_parameters *p, const char *mission, const char *robot_ns, const char *out_ns,
                       const char *log, int residual)
{
    static sp_run run; /* > 1 MB */
    int code = 2;
    if (sp_run_open(&run, p, mission, log, residual) != 0) return 2;
    try {
        /* Anonymous: a second runner of the same name would shut down the first in flight. */
        ros::init(ros::M_string(), NODE,
                  ros::init_options::NoSigintHandler | ros::init_options::NoRosout | ros::init_options::AnonymousName);
        handle_signals();
        if (ros::master::check()) code = serve(&run, p->model, robot_ns, out_ns);
        else
            sp_reject("no ROS master at ", (ros::master::getURI() + "; valid: ROS_MASTER_URI of a running one").c_str());
    } catch (const std::exception &error) {
        sp_reject("", error.what());
    }
    if (ros::isStarted()) ros::shutdown();
    return code != 0 ? code : sp_run_close(&run);
}
