/* Generated: the workspace of OSQP for legs. */
#ifndef LEGS_WORKSPACE_H
#define LEGS_WORKSPACE_H

#include <stddef.h>
#include <stdint.h>
#include "types.h"
#include "algebra_impl.h"
#include "qdldl_interface.h"

typedef struct {
    OSQPSettings settings;
    OSQPFloat sol_x[24];
    OSQPFloat sol_y[54];
    OSQPFloat sol_prim_inf_cert[54];
    OSQPFloat sol_dual_inf_cert[24];
    OSQPSolution sol;
    OSQPInfo info;
    OSQPInt data_P_csc_p[25];
    OSQPInt data_P_csc_i[84];
    OSQPFloat data_P_csc_x[84];
    OSQPCscMatrix data_P_csc;
    OSQPMatrix data_P;
    OSQPInt data_A_csc_p[25];
    OSQPInt data_A_csc_i[256];
    OSQPFloat data_A_csc_x[256];
    OSQPCscMatrix data_A_csc;
    OSQPMatrix data_A;
    OSQPFloat data_q_val[24];
    OSQPVectorf data_q;
    OSQPFloat data_l_val[54];
    OSQPVectorf data_l;
    OSQPFloat data_u_val[54];
    OSQPVectorf data_u;
    OSQPData data;
    OSQPInt linsys_L_p[79];
    OSQPInt linsys_L_i[332];
    OSQPFloat linsys_L_x[332];
    OSQPCscMatrix linsys_L;
    OSQPFloat linsys_Dinv[78];
    OSQPInt linsys_P[78];
    OSQPFloat linsys_bp[78];
    OSQPFloat linsys_sol[78];
    OSQPFloat linsys_rho_inv_vec[54];
    OSQPInt linsys_KKT_p[79];
    OSQPInt linsys_KKT_i[394];
    OSQPFloat linsys_KKT_x[394];
    OSQPCscMatrix linsys_KKT;
    OSQPInt linsys_PtoKKT[84];
    OSQPInt linsys_AtoKKT[256];
    OSQPInt linsys_rhotoKKT[54];
    OSQPFloat linsys_D[78];
    OSQPInt linsys_etree[78];
    OSQPInt linsys_Lnz[78];
    QDLDL_int linsys_iwork[234];
    QDLDL_bool linsys_bwork[78];
    QDLDL_float linsys_fwork[78];
    qdldl_solver linsys;
    OSQPFloat work_rho_vec_val[54];
    OSQPVectorf work_rho_vec;
    OSQPFloat work_rho_inv_vec_val[54];
    OSQPVectorf work_rho_inv_vec;
    OSQPInt work_constr_type_val[54];
    OSQPVectori work_constr_type;
    OSQPFloat work_x_val[24];
    OSQPVectorf work_x;
    OSQPFloat work_y_val[54];
    OSQPVectorf work_y;
    OSQPFloat work_z_val[54];
    OSQPVectorf work_z;
    OSQPFloat work_xz_tilde_val[78];
    OSQPVectorf work_xz_tilde;
    OSQPVectorf work_xtilde_view;
    OSQPVectorf work_ztilde_view;
    OSQPFloat work_x_prev_val[24];
    OSQPVectorf work_x_prev;
    OSQPFloat work_z_prev_val[54];
    OSQPVectorf work_z_prev;
    OSQPFloat work_Ax_val[54];
    OSQPVectorf work_Ax;
    OSQPFloat work_Px_val[24];
    OSQPVectorf work_Px;
    OSQPFloat work_Aty_val[24];
    OSQPVectorf work_Aty;
    OSQPFloat work_delta_y_val[54];
    OSQPVectorf work_delta_y;
    OSQPFloat work_Atdelta_y_val[24];
    OSQPVectorf work_Atdelta_y;
    OSQPFloat work_delta_x_val[24];
    OSQPVectorf work_delta_x;
    OSQPFloat work_Pdelta_x_val[24];
    OSQPVectorf work_Pdelta_x;
    OSQPFloat work_Adelta_x_val[54];
    OSQPVectorf work_Adelta_x;
    OSQPFloat work_D_temp_val[24];
    OSQPVectorf work_D_temp;
    OSQPFloat work_D_temp_A_val[24];
    OSQPVectorf work_D_temp_A;
    OSQPFloat work_E_temp_val[54];
    OSQPVectorf work_E_temp;
    OSQPWorkspace work;
    OSQPSolver solver;
} legs_space;
extern const legs_space legs_SPACE;
static const uint32_t legs_POINTERS[89] = {
    offsetof(legs_space, sol) + offsetof(OSQPSolution, x), offsetof(legs_space, sol) + offsetof(OSQPSolution, y), offsetof(legs_space, sol) + offsetof(OSQPSolution, prim_inf_cert), offsetof(legs_space, sol) + offsetof(OSQPSolution, dual_inf_cert),
    offsetof(legs_space, data_P_csc) + offsetof(OSQPCscMatrix, p), offsetof(legs_space, data_P_csc) + offsetof(OSQPCscMatrix, i), offsetof(legs_space, data_P_csc) + offsetof(OSQPCscMatrix, x), offsetof(legs_space, data_P) + offsetof(OSQPMatrix, csc),
    offsetof(legs_space, data_A_csc) + offsetof(OSQPCscMatrix, p), offsetof(legs_space, data_A_csc) + offsetof(OSQPCscMatrix, i), offsetof(legs_space, data_A_csc) + offsetof(OSQPCscMatrix, x), offsetof(legs_space, data_A) + offsetof(OSQPMatrix, csc),
    offsetof(legs_space, data_q) + offsetof(OSQPVectorf, values), offsetof(legs_space, data_l) + offsetof(OSQPVectorf, values), offsetof(legs_space, data_u) + offsetof(OSQPVectorf, values), offsetof(legs_space, data) + offsetof(OSQPData, P),
    offsetof(legs_space, data) + offsetof(OSQPData, A), offsetof(legs_space, data) + offsetof(OSQPData, q), offsetof(legs_space, data) + offsetof(OSQPData, l), offsetof(legs_space, data) + offsetof(OSQPData, u),
    offsetof(legs_space, linsys_L) + offsetof(OSQPCscMatrix, p), offsetof(legs_space, linsys_L) + offsetof(OSQPCscMatrix, i), offsetof(legs_space, linsys_L) + offsetof(OSQPCscMatrix, x), offsetof(legs_space, linsys_KKT) + offsetof(OSQPCscMatrix, p),
    offsetof(legs_space, linsys_KKT) + offsetof(OSQPCscMatrix, i), offsetof(legs_space, linsys_KKT) + offsetof(OSQPCscMatrix, x), offsetof(legs_space, linsys) + offsetof(qdldl_solver, L), offsetof(legs_space, linsys) + offsetof(qdldl_solver, Dinv),
    offsetof(legs_space, linsys) + offsetof(qdldl_solver, P), offsetof(legs_space, linsys) + offsetof(qdldl_solver, bp), offsetof(legs_space, linsys) + offsetof(qdldl_solver, sol), offsetof(legs_space, linsys) + offsetof(qdldl_solver, rho_inv_vec),
    offsetof(legs_space, linsys) + offsetof(qdldl_solver, KKT), offsetof(legs_space, linsys) + offsetof(qdldl_solver, PtoKKT), offsetof(legs_space, linsys) + offsetof(qdldl_solver, AtoKKT), offsetof(legs_space, linsys) + offsetof(qdldl_solver, rhotoKKT),
    offsetof(legs_space, linsys) + offsetof(qdldl_solver, D), offsetof(legs_space, linsys) + offsetof(qdldl_solver, etree), offsetof(legs_space, linsys) + offsetof(qdldl_solver, Lnz), offsetof(legs_space, linsys) + offsetof(qdldl_solver, iwork),
    offsetof(legs_space, linsys) + offsetof(qdldl_solver, bwork), offsetof(legs_space, linsys) + offsetof(qdldl_solver, fwork), offsetof(legs_space, work_rho_vec) + offsetof(OSQPVectorf, values), offsetof(legs_space, work_rho_inv_vec) + offsetof(OSQPVectorf, values),
    offsetof(legs_space, work_constr_type) + offsetof(OSQPVectori, values), offsetof(legs_space, work_x) + offsetof(OSQPVectorf, values), offsetof(legs_space, work_y) + offsetof(OSQPVectorf, values), offsetof(legs_space, work_z) + offsetof(OSQPVectorf, values),
    offsetof(legs_space, work_xz_tilde) + offsetof(OSQPVectorf, values), offsetof(legs_space, work_xtilde_view) + offsetof(OSQPVectorf, values), offsetof(legs_space, work_ztilde_view) + offsetof(OSQPVectorf, values), offsetof(legs_space, work_x_prev) + offsetof(OSQPVectorf, values),
    offsetof(legs_space, work_z_prev) + offsetof(OSQPVectorf, values), offsetof(legs_space, work_Ax) + offsetof(OSQPVectorf, values), offsetof(legs_space, work_Px) + offsetof(OSQPVectorf, values), offsetof(legs_space, work_Aty) + offsetof(OSQPVectorf, values),
    offsetof(legs_space, work_delta_y) + offsetof(OSQPVectorf, values), offsetof(legs_space, work_Atdelta_y) + offsetof(OSQPVectorf, values), offsetof(legs_space, work_delta_x) + offsetof(OSQPVectorf, values), offsetof(legs_space, work_Pdelta_x) + offsetof(OSQPVectorf, values),
    offsetof(legs_space, work_Adelta_x) + offsetof(OSQPVectorf, values), offsetof(legs_space, work_D_temp) + offsetof(OSQPVectorf, values), offsetof(legs_space, work_D_temp_A) + offsetof(OSQPVectorf, values), offsetof(legs_space, work_E_temp) + offsetof(OSQPVectorf, values),
    offsetof(legs_space, work) + offsetof(OSQPWorkspace, data), offsetof(legs_space, work) + offsetof(OSQPWorkspace, linsys_solver), offsetof(legs_space, work) + offsetof(OSQPWorkspace, rho_vec), offsetof(legs_space, work) + offsetof(OSQPWorkspace, rho_inv_vec),
    offsetof(legs_space, work) + offsetof(OSQPWorkspace, constr_type), offsetof(legs_space, work) + offsetof(OSQPWorkspace, x), offsetof(legs_space, work) + offsetof(OSQPWorkspace, y), offsetof(legs_space, work) + offsetof(OSQPWorkspace, z),
    offsetof(legs_space, work) + offsetof(OSQPWorkspace, xz_tilde), offsetof(legs_space, work) + offsetof(OSQPWorkspace, xtilde_view), offsetof(legs_space, work) + offsetof(OSQPWorkspace, ztilde_view), offsetof(legs_space, work) + offsetof(OSQPWorkspace, x_prev),
    offsetof(legs_space, work) + offsetof(OSQPWorkspace, z_prev), offsetof(legs_space, work) + offsetof(OSQPWorkspace, Ax), offsetof(legs_space, work) + offsetof(OSQPWorkspace, Px), offsetof(legs_space, work) + offsetof(OSQPWorkspace, Aty),
    offsetof(legs_space, work) + offsetof(OSQPWorkspace, delta_y), offsetof(legs_space, work) + offsetof(OSQPWorkspace, Atdelta_y), offsetof(legs_space, work) + offsetof(OSQPWorkspace, delta_x), offsetof(legs_space, work) + offsetof(OSQPWorkspace, Pdelta_x),
    offsetof(legs_space, work) + offsetof(OSQPWorkspace, Adelta_x), offsetof(legs_space, solver) + offsetof(OSQPSolver, settings), offsetof(legs_space, solver) + offsetof(OSQPSolver, solution), offsetof(legs_space, solver) + offsetof(OSQPSolver, info),
    offsetof(legs_space, solver) + offsetof(OSQPSolver, work),
};

#endif
